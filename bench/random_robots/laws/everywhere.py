"""One cause at all joints at once: a late bus, a slow controller, a sagging supply, cold grease."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..dice import chance
from .base import Law
from .drives import Gain
from .targets import Delay, Lag


class _AllCommands(Law):
    """A law of the commands, the same for each servo."""

    at = "robot"

    @property
    def places(self) -> tuple[str, ...]:
        return self.site.robot.joints


class DelayEverywhere(_AllCommands, Delay):
    """Every command arrives late."""

    sizes = (2e-3, 1.0)

    def commands(self, steps: np.ndarray, step_s: float) -> np.ndarray:
        return np.column_stack([self.shaped(column, step_s) for column in steps.T])


class LagEverywhere(_AllCommands, Lag):
    """Every command passes the same first-order filter."""

    sizes = (2e-3, 2.0)

    def commands(self, steps: np.ndarray, step_s: float) -> np.ndarray:
        return np.column_stack([self.shaped(column, step_s) for column in steps.T])


class GainEverywhere(Gain):
    """A supply that sags: every servo is weaker by the same factor."""

    at = "robot"

    def draw(self, random: np.random.Generator) -> None:
        self._way = -1.0

    def edit(self, spec: Any) -> None:
        factor = self.values()["factor"]
        for servo in self.site.robot.servos:
            actuator = spec.actuator(servo.actuator)
            actuator.gainprm[0] *= factor
            actuator.biasprm[1:3] = np.asarray(actuator.biasprm[1:3]) * factor

    @property
    def places(self) -> tuple[str, ...]:
        return self.site.robot.joints


class ViscousEverywhere(Law):
    """Cold grease: every joint's damping grows by the same share."""

    key = "viscous_friction"
    at = "robot"
    sizes = (5e-3, 8.0)

    def values(self) -> dict[str, float]:
        return {"share": self.size}

    def nominal_change(self) -> float | None:
        return float(np.log1p(self.size))

    def edit(self, spec: Any) -> None:
        for name in self.site.robot.joints:
            joint = spec.joint(name)
            damping = np.array(joint.damping, float)
            damping[0] *= 1 + self.size
            joint.damping = damping

    @property
    def places(self) -> tuple[str, ...]:
        return self.site.robot.joints


class CoulombEverywhere(ViscousEverywhere):
    """Dry bearings: every joint's dry friction grows by the same share of its torque scale."""

    key = "coulomb_friction"
    sizes = (1e-4, 2.0)

    def draw(self, random: np.random.Generator) -> None:
        self._by_own = chance(random, 0.5) and bool(np.all(self.site.robot.friction > 0))

    def values(self) -> dict[str, float]:
        return {"share": 20 * self.size} if self._by_own else {}

    def nominal_change(self) -> float | None:
        own, more = self.site.robot.friction, self._more()
        return float(np.median(np.log1p(more / own))) if np.all(own > 0) else None

    def edit(self, spec: Any) -> None:
        for name, more in zip(self.site.robot.joints, self._more(), strict=True):
            joint = spec.joint(name)
            joint.frictionloss = joint.frictionloss + more

    def _more(self) -> np.ndarray:
        """(j,) N m of dry friction beside each joint's own."""
        robot = self.site.robot
        if self._by_own:
            return self.size * 20 * robot.friction
        kp = np.array([robot.servos[robot.servo_of(index)].kp for index in range(len(robot.joints))])
        unit = np.array([0.1 if link.slide else 1.0 for link in robot.tree.links])
        return self.size * np.maximum(robot.gravity_load, 0.03 * kp * unit)
