"""Friction. Dry friction goes where MuJoCo's solver makes it stick: into the bound `frictionloss`, step by step."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..dice import chance, sign
from .base import Law, change


class Viscous(Law):
    """More damping, or less of the model's own; the size is in parts of critical damping."""

    key = "viscous_friction"
    sizes = (1e-3, 10.0)

    def draw(self, random: np.random.Generator) -> None:
        self.less = chance(random, 0.3) and self.site.robot.damping[self.site.joint] > 0

    def values(self) -> dict[str, float]:
        own = float(self.site.robot.damping[self.site.joint])
        if self.less:
            return {"damping": -own * (1 - np.exp(-self.size))}
        return {"damping": self.size * 2 * float(np.sqrt(self.site.kp * self.site.inertia))}

    def nominal_change(self) -> float | None:
        return change(float(self.site.robot.damping[self.site.joint]), self.values()["damping"])

    def edit(self, spec: Any) -> None:
        joint = self.joint_of(spec)
        damping = np.array(joint.damping, float)
        damping[0] = max(damping[0] + self.values()["damping"], 0.0)
        joint.damping = damping


class Coulomb(Law):
    """More dry friction, or less of the model's own; the size is in parts of the torque scale."""

    key = "coulomb_friction"
    sizes = (1e-4, 3.0)

    def draw(self, random: np.random.Generator) -> None:
        self.less = chance(random, 0.2) and self.site.robot.friction[self.site.joint] > 0

    def values(self) -> dict[str, float]:
        if self.less:
            return {"friction": -float(self.site.robot.friction[self.site.joint]) * (1 - np.exp(-self.size))}
        return {"friction": self.size * self.site.torque}

    def nominal_change(self) -> float | None:
        return change(float(self.site.robot.friction[self.site.joint]), self.values()["friction"])

    def edit(self, spec: Any) -> None:
        joint = self.joint_of(spec)
        joint.frictionloss = max(joint.frictionloss + self.values()["friction"], 0.0)


class _StepFriction(Law):
    """Dry friction whose bound changes while the robot moves."""

    each_step = True
    claims = "friction"
    sizes = (1e-4, 3.0)

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._own = float(model.dof_frictionloss[self.site.joint])

    def step(self, target: np.ndarray) -> None:
        joint = self.site.joint
        more = self.bound(float(self.data.qpos[joint]), float(self.data.qvel[joint]))
        self.model.dof_frictionloss[joint] = self._own + more

    def bound(self, angle: float, speed: float) -> float:
        """N m beside the robot's own."""
        raise NotImplementedError


class Stribeck(_StepFriction):
    """Friction that is highest at rest: breakaway * exp(-(speed / velocity)^2)."""

    key = "stribeck_friction"

    def draw(self, random: np.random.Generator) -> None:
        self._velocity = float(random.uniform(0.1, 0.5)) * self.site.speed

    def values(self) -> dict[str, float]:
        return {"breakaway": self.size * self.site.torque, "velocity": self._velocity}

    def bound(self, angle: float, speed: float) -> float:
        return self.size * self.site.torque * float(np.exp(-((speed / self._velocity) ** 2)))


class Load(_StepFriction):
    """A brake that the servo's own torque presses: coefficient * |torque|."""

    key = "load_friction"
    at = "lone"
    sizes = (1e-3, 0.6)

    def values(self) -> dict[str, float]:
        return {"coefficient": self.size}

    def bound(self, angle: float, speed: float) -> float:
        return self.size * abs(float(self.data.actuator_force[self.site.servo]))


class SquareRoot(_StepFriction):
    """Drag with the square root of the speed, as thin grease has."""

    key = "x_square_root_damping"

    def bound(self, angle: float, speed: float) -> float:
        return self.size * self.site.torque * float(np.sqrt(abs(speed) / self.site.speed))


class Fluid(_StepFriction):
    """Drag with the square of the speed, as oil in a housing has."""

    key = "x_fluid_drag"

    def bound(self, angle: float, speed: float) -> float:
        return self.size * self.site.torque * min((speed / self.site.speed) ** 2, 30.0)


class Patch(_StepFriction):
    """Grit: dry friction within a part of the travel."""

    key = "x_sticky_patch"

    def draw(self, random: np.random.Generator) -> None:
        self._centre = float(np.quantile(self.site.angle, random.uniform(0.3, 0.7)))
        self._half = self.site.span * float(random.uniform(0.03, 0.08))

    def bound(self, angle: float, speed: float) -> float:
        return self.size * self.site.torque if abs(angle - self._centre) < self._half else 0.0


class Warming(_StepFriction):
    """Cold grease that its own work warms: friction beside the model's own that fades with the way that was gone."""

    key = "x_warming_friction"

    def draw(self, random: np.random.Generator) -> None:
        way = self.site.speed * len(self.site.angle) / self.site.robot.rate_hz
        self._way = way * float(random.uniform(0.15, 0.4))
        self._cools_s = float(random.uniform(20, 60))

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._heat = 0.0

    def bound(self, angle: float, speed: float) -> float:
        self._heat += self.step_s * (abs(speed) / self._way - self._heat / self._cools_s)
        return self.size * self.site.torque * float(np.exp(-self._heat))


class OneWay(Law):
    """A ratchet's drag: viscous friction in one direction only."""

    key = "x_one_way_damping"
    each_step = True

    def draw(self, random: np.random.Generator) -> None:
        self._way = sign(random)

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._own = float(model.dof_damping[self.site.joint])

    def step(self, target: np.ndarray) -> None:
        joint = self.site.joint
        against = self._way * float(self.data.qvel[joint]) > 0
        more = self.size * 2 * float(np.sqrt(self.site.kp * self.site.inertia)) if against else 0.0
        self.model.dof_damping[joint] = self._own + more
