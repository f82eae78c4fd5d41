"""What the gate knows of the hand: where its joints were last measured, and where it was last told to be."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.gate.limits import Limits
from twin_daemon.gate.readings import Doubt, Readings
from twin_daemon.gate.settings import GateSettings
from twin_daemon.simulation.twin import TwinModel

_SAG_RAD = 0.1  # a servo under load rests so far from its target


class Feedback:
    """By joint (j,) as measured, by command (c,) as the gate needs it."""

    def __init__(self, twin: TwinModel, limits: Limits, settings: GateSettings) -> None:
        self._limits = limits
        self._joints = twin.joints
        self._readings = Readings(twin.hand, twin.joints, settings)
        self._heard = np.full(len(twin.joints), np.nan), np.full(len(twin.joints), -np.inf)
        self._of_commands: tuple[Any, np.ndarray, np.ndarray] | None = None
        self._told = np.full(len(limits.names), np.nan)
        self.effort: dict[str, float] = {}
        parts = [[twin.joints.index(j) for j in info.joints] for info in twin.hand.description.commands.values()]
        self._parts = np.array([joint for joints in parts for joint in joints], dtype=int)
        self._firsts = np.cumsum([0, *map(len, parts[:-1])])

    def measured(self, position: np.ndarray, arrival_s: np.ndarray, effort: Mapping[str, float] | None) -> None:
        """Takes over positions (j,) rad and their arrivals (j,) s, and judges whether they can be."""
        self._readings.take(position, arrival_s)
        known = np.isfinite(position)
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
        return self._by_command()[0]

    def _by_command(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (c,) rad and arrivals (c,) s by command, computed once for what was heard last."""
        heard, known = self._heard, self._of_commands
        if known is None or known[0] is not heard:
            arrival_s = np.minimum.reduceat(heard[1][self._parts], self._firsts)
            known = self._of_commands = heard, self._summed(heard[0]), arrival_s
        return known[1:]

    def _summed(self, joints: np.ndarray) -> np.ndarray:
        return np.add.reduceat(joints[..., self._parts], self._firsts, axis=-1)

    def doubts(self, now_s: float) -> list[Doubt]:
        """Readings of the last moments that cannot be."""
        return self._readings.doubts(now_s)

    def doubted(self, now_s: float) -> np.ndarray:
        """(c,) bool: the commands of the joints whose readings cannot be."""
        wrong = {doubt.joint for doubt in self.doubts(now_s)}
        return self._summed(np.array([float(joint in wrong) for joint in self._joints])) > 0.0

    def farthest(self, start: np.ndarray, now_s: float) -> np.ndarray:
        """(c,) rad: how far from `start` (c,) the hand was at most in the last moments."""
        return np.abs(self._summed(self._readings.recent(now_s)) - start).max(axis=0, initial=0.0)

    def arrivals_s(self) -> np.ndarray:
        """(c,) when the older of each command's joints was heard, s."""
        return self._by_command()[1]

    def ages_s(self, now_s: float) -> np.ndarray:
        """(c,) s since each command's joints were measured."""
        return now_s - self.arrivals_s()

    def start(self, setpoint: np.ndarray) -> np.ndarray:
        """(c,) where each command is: its setpoint, else what the hand was last told if it is there, else measured."""
        measured = self.by_command()
        told = np.where(np.abs(self._told - measured) <= _SAG_RAD, self._told, measured)
        return np.where(np.isfinite(setpoint), setpoint, self._limits.clip(told))
