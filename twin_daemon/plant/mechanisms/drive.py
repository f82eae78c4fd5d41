"""The motor and its amplifier: gain, limits, cogging, heat, and pulling better than releasing."""

from __future__ import annotations

import numpy as np

from .base import Mechanism, State


class _OnServos(Mechanism):
    stages = ("drive",)

    def prepare(self) -> None:
        self.rows = self.command_rows()


class Gain(_OnServos):
    """All of the servo's torque times `value`: a weak magnet, a wrong constant. The limit of the drive stays."""

    def drive(self, state: State) -> None:
        rows = self.rows
        torque = state.torque[rows] * self.value
        state.torque[rows] = np.clip(torque, self.rig.force_low[rows], self.rig.force_high[rows])


class Saturation(_OnServos):
    """The torque is cut at `value` N m either way."""

    def drive(self, state: State) -> None:
        state.torque[self.rows] = np.clip(state.torque[self.rows], -self.value, self.value)


class AsymmetricGain(_OnServos):
    """Stronger by `value` one way and weaker by it the other: the tendon pulls, a spring or its antagonist releases."""

    def drive(self, state: State) -> None:
        torque = state.torque[self.rows]
        state.torque[self.rows] = torque * (1.0 + self.value * np.sign(torque))


class Ripple(_OnServos):
    """Cogging: the rotor prefers `cycles` angles a radian."""

    stages = ("joint",)

    def joint(self, state: State) -> None:
        phase = self.more["cycles"] * state.servo_angle[self.rows] + self.more["phase"]
        state.drag[self.rows] -= self.value * np.sin(phase)


class ThermalFade(_OnServos):
    """Copper and magnets warm up with the mean square of torque (in parts of `hot` N m) and the torque fades.

    One thermal mass: dh/dt = ((torque / hot)^2 - h) / time; the torque is times 1 - value * h / (1 + h).
    """

    def reset(self) -> None:
        self._heat = np.zeros(len(self.rows))

    def drive(self, state: State) -> None:
        torque = state.torque[self.rows] * (1.0 - self.value * self._heat / (1.0 + self._heat))
        state.torque[self.rows] = torque
        warming = (torque / self.more["hot"]) ** 2 - self._heat
        self._heat = self._heat + warming * (state.step_s / self.more["time"])
