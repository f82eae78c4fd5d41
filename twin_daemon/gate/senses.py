"""What the gate knows of the hand: where its joints were last measured, and where it was last told to be."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin_daemon.gate.limits import Limits
from twin_daemon.simulation.twin import TwinModel

_BEYOND_RAD = 1.0  # of its range; no reading of a joint is farther out
_SAG_RAD = 0.1  # a servo under load rests so far from its target


class Senses:
    """By joint (j,) as measured, by command (c,) as the gate needs it."""

    def __init__(self, twin: TwinModel, limits: Limits) -> None:
        self._limits = limits
        self._heard = np.full(len(twin.joints), np.nan), np.full(len(twin.joints), -np.inf)
        self._told = np.full(len(limits.names), np.nan)
        self.effort: dict[str, float] = {}
        low, high = np.array([twin.hand.joint_range_rad.get(name, (-np.inf, np.inf)) for name in twin.joints]).T
        bounded = np.isfinite(high - low)
        self._middle = np.where(bounded, 0.5 * (low + high), 0.0)
        self._reach = np.where(bounded, 0.5 * (high - low) + _BEYOND_RAD, np.inf)
        parts = [[twin.joints.index(j) for j in info.joints] for info in twin.hand.description.commands.values()]
        self._parts = np.array([joint for joints in parts for joint in joints], dtype=int)
        self._firsts = np.cumsum([0, *map(len, parts[:-1])])

    def measured(self, position: np.ndarray, arrival_s: np.ndarray, effort: Mapping[str, float] | None) -> None:
        """Takes over positions (j,) rad and their arrivals (j,) s. A reading that its joint cannot reach says nothing:
        the joint grows old."""
        with np.errstate(invalid="ignore"):
            known = np.abs(position - self._middle) <= self._reach
        before, heard_s = self._heard
        # replaced as a whole, so that no reader needs a lock: the stream of joint states never waits for the gate
        self._heard = np.where(known, position, before), np.where(known, arrival_s, heard_s)
        if effort:
            self.effort = {**self.effort, **effort}

    def told(self, row: np.ndarray) -> None:
        """The hand has been sent to `row` (c,) rad, NaN where it says nothing."""
        self._told = np.where(np.isfinite(row), row, self._told)

    @property
    def pose(self) -> np.ndarray:
        """(j,) rad as last measured; NaN before the first time."""
        return self._heard[0]

    def by_command(self) -> np.ndarray:
        """(c,) rad: the sum of each command's joints."""
        return np.add.reduceat(self._heard[0][self._parts], self._firsts)

    def arrivals_s(self) -> np.ndarray:
        """(c,) when the older of each command's joints was heard, s."""
        return np.minimum.reduceat(self._heard[1][self._parts], self._firsts)

    def ages_s(self, now_s: float) -> np.ndarray:
        """(c,) s since each command's joints were measured."""
        return now_s - self.arrivals_s()

    def start(self, setpoint: np.ndarray) -> np.ndarray:
        """(c,) where each command is: its setpoint, else what the hand was last told if it is there, else measured."""
        measured = self.by_command()
        told = np.where(np.abs(self._told - measured) <= _SAG_RAD, self._told, measured)
        return np.where(np.isfinite(setpoint), setpoint, self._limits.clip(told))
