"""What the hand was told: one continuous-time signal from a command stream or a trajectory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from twin_daemon.recordings.recording import Commands
from twin_daemon.signals.trajectory import Trajectory


@dataclass(frozen=True)
class CommandSignal:
    """Position targets by command name, as a function of time since the recording's first sample.

    `time_s` (m,), `position` (m, k) rad. A controller holds a streamed target until the next one arrives
    ("hold"); between the points of a trajectory it interpolates ("linear"). Before the first and after the
    last point the signal stays where it is. A column is NaN until its first command.
    """

    names: tuple[str, ...]
    time_s: np.ndarray
    position: np.ndarray
    interpolation: Literal["hold", "linear"]

    @classmethod
    def from_stream(cls, commands: Commands, start_ns: int) -> CommandSignal:
        """A recorded stream, with each name's last target carried forward over messages without it."""
        position = np.array(commands.position, dtype=float)
        for column in position.T:
            known = np.flatnonzero(np.isfinite(column))
            if known.size:
                latest = np.maximum.accumulate(np.where(np.isfinite(column), np.arange(column.size), -1))
                column[latest >= 0] = column[latest[latest >= 0]]
        time_s = (commands.stamp_ns - start_ns) * 1e-9
        return cls(commands.names, time_s, position, commands.interpolation)

    @classmethod
    def from_trajectory(cls, trajectory: Trajectory, rename: Mapping[str, str] | None = None) -> CommandSignal:
        """A trajectory whose time 0 is the recording's first sample; shift it by sampling at t - onset."""
        names = tuple((rename or {}).get(name, name) for name in trajectory.joints)
        return cls(names, np.asarray(trajectory.times_s, float), np.asarray(trajectory.positions, float), "linear")

    def sample(self, time_s: np.ndarray) -> np.ndarray:
        """Targets at the given times: (T,) s -> (T, k) rad."""
        time_s = np.asarray(time_s, float)
        if self.interpolation == "hold":
            # a stamp that lies a rounding error after the step's time still belongs to it
            index = np.searchsorted(self.time_s, time_s + 1e-7, side="right") - 1
            return self.position[np.clip(index, 0, len(self.time_s) - 1)]
        return np.column_stack([np.interp(time_s, self.time_s, column) for column in self.position.T])

    def mean(self, time_s: np.ndarray, width_s: float) -> np.ndarray:
        """The mean of each target over `width_s` around the given times: (T,) s -> (T, k) rad.

        What a simulation with this time step can know of steps that fall between its own: it moves smoothly with
        the times, where `sample` jumps by a whole step.
        """
        time_s = np.asarray(time_s, float)
        if self.interpolation != "hold":
            return self.sample(time_s)
        held, area = self._integral
        ends = []
        for at in (time_s + 0.5 * width_s, time_s - 0.5 * width_s):
            index = np.clip(np.searchsorted(self.time_s, at, side="right") - 1, 0, len(self.time_s) - 1)
            ends.append(area[index] + held[index] * (at - self.time_s[index])[:, None])
        known = np.isfinite(self.sample(time_s - 0.5 * width_s))
        return np.where(known, (ends[0] - ends[1]) / width_s, np.nan)

    @cached_property
    def _integral(self) -> tuple[np.ndarray, np.ndarray]:
        """((m, k) rad, (m, k) rad s): the held targets, 0 where there is none yet, and their integral."""
        held = np.nan_to_num(self.position)
        area = np.zeros_like(held)
        area[1:] = np.cumsum(held[:-1] * np.diff(self.time_s)[:, None], axis=0)
        return held, area

    def only(self, columns: np.ndarray) -> CommandSignal:
        """The same signal with some of its targets."""
        return replace(self, names=tuple(self.names[i] for i in columns), position=self.position[:, columns])
