"""Friction: viscous, dry, fading with speed, growing with load, and grit.

Dry friction is an elasto-plastic bristle: it resists like a stiff spring until the torque reaches the level at which it
slides (Prandtl; one element of the generalised Maxwell-slip model, Al-Bender, Lampaert and Swevers, IEEE TAC 50, 2005).
Unlike a smoothed sign(v) it holds a load at rest, and it never gives back more than the bristle stored.
"""

from __future__ import annotations

import numpy as np

from ..rig import REFERENCE_STEP_S
from .base import AtPorts, State


class ViscousFriction(AtPorts):
    """Torque against the speed. At joints it goes where MuJoCo integrates damping implicitly: stable at any value."""

    def prepare(self) -> None:
        super().prepare()
        self._given = np.zeros(self.ports.split)

    def update(self) -> None:
        value = self.ordered(self.value)
        at_joints, self._along = value[: self.ports.split], value[self.ports.split :]
        self.rig.model.dof_damping[self.ports.dof] += at_joints - self._given
        self._given = at_joints.copy()

    def joint(self, state: State) -> None:
        rows = self.ports.command
        if rows.size:
            state.drag[rows] -= self._along * state.speed[rows]


class Bristles:
    """(p,) elasto-plastic bristles, with a little damping while they stick."""

    def __init__(self, inertia: np.ndarray) -> None:
        # A tenth of what the step could carry: presliding is far below a sensor's step
        self.stiffness = 0.1 * inertia / REFERENCE_STEP_S**2
        self.damping = 0.6 * np.sqrt(self.stiffness * inertia)
        self.bend = np.zeros_like(inertia)

    def reset(self) -> None:
        self.bend[:] = 0.0

    def torque(self, speed: np.ndarray, level: np.ndarray, step_s: float) -> np.ndarray:
        """N m at the given speed, where the bristles slide at `level` N m."""
        most = level / self.stiffness
        np.clip(self.bend + step_s * speed, -most, most, out=self.bend)
        return -np.clip(self.stiffness * self.bend + self.damping * speed, -level, level)


class _Dry(AtPorts):
    def prepare(self) -> None:
        super().prepare()
        self.bristles = Bristles(self.ports.inertia)

    def reset(self) -> None:
        self.bristles.reset()

    def level(self, state: State) -> np.ndarray:
        """(p,) N m at which the friction slides."""
        raise NotImplementedError

    def joint(self, state: State) -> None:
        torque = self.bristles.torque(self.ports.speed(state), self.level(state), state.step_s)
        self.ports.add(state, torque)


class CoulombFriction(_Dry):
    """The same level at every speed."""

    def update(self) -> None:
        self._level = self.ordered(self.value)

    def level(self, state: State) -> np.ndarray:
        return self._level


class LoadFriction(_Dry):
    """The level grows with the torque that the servo transmits: a tendon pressed into its sheath, teeth into teeth."""

    def update(self) -> None:
        self._share = self.ordered(self.value)
        self._rows = np.maximum(self.ports.driven_by, 0)
        self._share = np.where(self.ports.driven_by >= 0, self._share, 0.0)

    def level(self, state: State) -> np.ndarray:
        return self._share * np.abs(state.torque[self._rows])


class StickyPatch(_Dry):
    """Grit: friction within one band of angles, with edges a tenth of its width."""

    def update(self) -> None:
        low, high = self.ports.low, self.ports.high
        low, high = np.maximum(low, -np.pi), np.minimum(high, np.pi)
        self._level = self.ordered(self.value)
        self._center = low + self.ordered(self.more["center"]) * (high - low)
        self._half = 0.5 * self.ordered(self.more["width"]) * (high - low)

    def level(self, state: State) -> np.ndarray:
        inside = self._half - np.abs(self.ports.angle(state) - self._center)
        return self._level * np.clip(inside / (0.2 * self._half), 0.0, 1.0)


class StribeckFriction(AtPorts):
    """Breakaway torque that fades with speed, by the LuGre model.

    Canudas de Wit, Olsson, Astrom and Lischinsky, IEEE TAC 40 (1995); level over speed after Armstrong-Helouvry, Dupont
    and Canudas de Wit, Automatica 30 (1994): g(v) = F exp(-(v / v_s)^2). The bristle's rate is solved implicitly.
    """

    def prepare(self) -> None:
        super().prepare()
        self._stiffness = 0.1 * self.ports.inertia / REFERENCE_STEP_S**2
        self._damping = 0.6 * np.sqrt(self._stiffness * self.ports.inertia)
        self._bend = np.zeros_like(self._stiffness)

    def update(self) -> None:
        self._level = self.ordered(self.value)
        self._velocity = self.ordered(self.more["velocity"])

    def reset(self) -> None:
        self._bend[:] = 0.0

    def joint(self, state: State) -> None:
        speed = self.ports.speed(state)
        level = self._level * np.exp(-((speed / self._velocity) ** 2)) + 1e-12
        pace = self._stiffness * np.abs(speed) / level
        self._bend[:] = (self._bend + state.step_s * speed) / (1.0 + state.step_s * pace)
        spring = self._stiffness * self._bend
        self.ports.add(state, -np.clip(spring + self._damping * speed, -level, level))
