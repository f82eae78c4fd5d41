"""Between the bus and the servo: delay, slew, lag, and controllers that look away from small errors."""

from __future__ import annotations

import numpy as np

from .base import Mechanism, State


class _OnCommands(Mechanism):
    stages = ("command",)

    def prepare(self) -> None:
        self.rows = self.command_rows()
        self._past: np.ndarray | None = None

    def reset(self) -> None:
        self._past = None


class CommandDelay(_OnCommands):
    """A target reaches the servo `value` s after it was set (to a step of the plant)."""

    def update(self) -> None:
        self._steps = np.rint(self.value / self.rig.step_s).astype(int)
        self._size = int(self._steps.max()) + 1
        self._columns = np.arange(len(self.rows))
        self._past = None

    def command(self, state: State) -> None:
        if self._past is None:
            self._past = np.tile(state.target[self.rows], (self._size, 1))
            self._now = 0
        self._now = (self._now + 1) % self._size
        self._past[self._now] = state.target[self.rows]
        state.target[self.rows] = self._past[(self._now - self._steps) % self._size, self._columns]


class RateLimit(_OnCommands):
    """The target moves at most `value` rad/s."""

    def command(self, state: State) -> None:
        wanted = state.target[self.rows]
        if self._past is None:
            self._past = wanted
        most = self.value * state.step_s
        self._past = np.clip(wanted, self._past - most, self._past + most)
        state.target[self.rows] = self._past


class CommandLag(_OnCommands):
    """First-order lag with time constant `value` s, exact for a held target."""

    def command(self, state: State) -> None:
        wanted = state.target[self.rows]
        if self._past is None:
            self._past = wanted
        with np.errstate(divide="ignore"):
            keep = np.exp(-state.step_s / self.value)
        self._past = wanted + keep * (self._past - wanted)
        state.target[self.rows] = self._past


class DeadBand(Mechanism):
    """The controller gives no torque while the error is within the band, and the whole of it outside."""

    stages = ("drive",)

    def prepare(self) -> None:
        self.rows = self.command_rows()

    def drive(self, state: State) -> None:
        error = state.target[self.rows] - state.servo_angle[self.rows]
        state.torque[self.rows] *= np.abs(error) >= self.value


class DeadZone(Mechanism):
    """The controller is silent while the error is within `value` rad, and counts the error from there outside of it."""

    stages = ("drive",)

    def prepare(self) -> None:
        self.rows = self.command_rows()

    def drive(self, state: State) -> None:
        rig, rows = self.rig, self.rows
        goal = -(rig.gain[rows] * state.target[rows] + rig.bias[rows]) / rig.pull[rows]
        error = goal - state.servo_angle[rows]
        beyond = np.sign(error) * np.maximum(np.abs(error) - self.value, 0.0)
        torque = -rig.pull[rows] * beyond + rig.brake[rows] * state.servo_speed[rows] * (beyond != 0.0)
        state.torque[rows] = np.clip(torque, rig.force_low[rows], rig.force_high[rows])
