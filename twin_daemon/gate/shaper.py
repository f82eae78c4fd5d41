"""The setpoint on its way to a target: never beyond its bounds, never faster or more sudden than its limits.

Each turn moves by v dt and may change v by at most a dt. With the distance e to a place that must not be passed,
v dt + v^2 / 2a <= e holds after every turn: what is left is enough to brake, whatever the next turns' lengths are
(braking by a dt costs v dt - a dt^2 / 2 less of it, and the left side shrinks by as much or more).
"""

from __future__ import annotations

import numpy as np

from twin_daemon.gate.limits import Limits

_THERE_RAD = 1e-9


class Shaper:
    """Position (c,) rad and velocity (c,) rad/s of the setpoints; NaN where no command has been given yet."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._twice_acceleration = 2.0 * limits.acceleration
        self._room = np.empty((3, len(limits.names)))
        self._dt_s = np.nan  # of the last turn; most are as long
        self._change = self._squared = np.zeros(len(limits.names))
        self.forget()

    def begin(self, position: np.ndarray) -> None:
        """Sets the setpoints of commands that have none from `position` (c,), where it is known; at rest."""
        fresh = ~self.given & np.isfinite(position)
        self.position[fresh] = self._limits.clip(position)[fresh]
        self.given = self.given | fresh
        self.is_given = bool(self.given.any())

    def forget(self) -> None:
        """No command has a setpoint."""
        self.position = np.full(len(self._limits.names), np.nan)
        self.velocity = np.zeros(len(self._limits.names))
        self.still = True
        """Whether all setpoints are at rest."""
        self.given = np.zeros(len(self._limits.names), dtype=bool)
        """(c,) which commands have a setpoint. Replaced as a whole."""
        self.is_given = False
        """Whether any command has one."""

    def stopping(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """(c,) where setpoints with this position and velocity come to rest when they brake."""
        return position + velocity * np.abs(velocity) / (2.0 * self._limits.acceleration)

    def toward(self, target: np.ndarray, dt_s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position and velocity one turn later, towards `target` (c,); NaN there means: come to rest."""
        limits, velocity = self._limits, self.velocity
        if dt_s != self._dt_s:
            self._dt_s, self._change = dt_s, limits.acceleration * dt_s
            self._squared = self._change * self._change
        change = self._change
        aims = np.isfinite(target)
        away = np.where(aims, target - self.position, 0.0)
        room = self._room  # to the target, and to either bound
        np.abs(away, out=room[0])
        np.subtract(self.position, limits.lower, out=room[1])
        np.subtract(limits.upper, self.position, out=room[2])
        to_target, to_lower, to_upper = self._braking(room)
        wanted = np.copysign(np.minimum(to_target, limits.velocity), away)
        wanted = np.minimum(np.maximum(wanted, velocity - change), velocity + change)
        # a target may have turned round; the bounds of the joint are still never passed
        wanted = np.minimum(np.maximum(wanted, -to_lower), to_upper)
        wanted = np.where(self.given, wanted, 0.0)
        position = limits.clip(self.position + wanted * dt_s)
        # the last nanoradian, which would otherwise be halved for ever
        near = aims & (room[0] <= _THERE_RAD)
        if np.count_nonzero(near):
            there = near & (np.abs(velocity) <= change)
            position, wanted = np.where(there, limits.clip(target), position), np.where(there, 0.0, wanted)
        return position, wanted  # NaN stays NaN where none is given

    def take(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Makes what `toward` proposed the setpoints."""
        self.position, self.velocity = position, velocity
        self.still = not np.count_nonzero(velocity)

    def _braking(self, distance: np.ndarray) -> np.ndarray:
        """The greatest v with v dt + v^2 / 2a <= distance, for this turn's dt; 0 where there is no room."""
        return np.sqrt(self._squared + self._twice_acceleration * np.fmax(distance, 0.0)) - self._change
