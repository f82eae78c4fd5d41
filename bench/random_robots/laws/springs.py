"""Torques of the angle: springs, stops, memory of the past motion, who moves first on a coupled tendon, a notch."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..dice import chance, log_uniform, pick, sign
from .base import Law


class _Torque(Law):
    """A torque at the joint in each step."""

    each_step = True

    def step(self, target: np.ndarray) -> None:
        joint = self.site.joint
        torque = self.of(float(self.data.qpos[joint]), float(self.data.qvel[joint]))
        self.data.qfrc_applied[joint] += torque

    def of(self, angle: float, speed: float) -> float:
        """N m"""
        raise NotImplementedError


class Spring(_Torque):
    """preload - stiffness * angle: a cable that pulls, a return spring."""

    key = "spring"
    sizes = (1e-4, 2.0)

    def draw(self, random: np.random.Generator) -> None:
        kind = pick(random, ("stiffness", "preload", "both"))
        self._stiffness = 0.0 if kind == "preload" else self.site.kp
        self._preload = 0.0 if kind == "stiffness" else sign(random) * self.site.kp * self.site.unit * 0.3

    def values(self) -> dict[str, float]:
        return {"stiffness": self.size * self._stiffness, "preload": self.size * self._preload}

    def of(self, angle: float, speed: float) -> float:
        return self.size * (self._preload - self._stiffness * angle)


class Cubic(_Torque):
    """-cubic * (angle - centre)^3: a spring that stiffens."""

    key = "nonlinear_spring"
    sizes = (1e-4, 3.0)

    def draw(self, random: np.random.Generator) -> None:
        self._centre = float(np.quantile(self.site.angle, random.uniform(0.25, 0.75)))

    def values(self) -> dict[str, float]:
        return {"cubic": self.size * self.site.kp / (0.5 * self.site.span) ** 2, "centre": self._centre}

    def of(self, angle: float, speed: float) -> float:
        return -self.size * self.site.kp / (0.5 * self.site.span) ** 2 * (angle - self._centre) ** 3


class Stop(_Torque):
    """A stop that begins before the joint's range ends, at one end or both."""

    key = "joint_stop"
    sizes = (1e-3, 0.45)

    def draw(self, random: np.random.Generator) -> None:
        self._ends = pick(random, ((True, False), (False, True), (True, True)))
        self._stiffness = self.site.kp * log_uniform(random, 1.0, 10.0)
        self._low, self._high = float(self.site.angle.min()), float(self.site.angle.max())

    def values(self) -> dict[str, float]:
        link, depth = self.site.robot.tree.links[self.site.joint], self.size * self.site.span
        out = {"stiffness": self._stiffness}
        if self._ends[0]:
            out["upper"] = link.high - (self._high - depth)
        if self._ends[1]:
            out["lower"] = self._low + depth - link.low
        return out

    def of(self, angle: float, speed: float) -> float:
        depth, torque = self.size * self.site.span, 0.0
        if self._ends[0]:
            torque -= self._stiffness * max(angle - (self._high - depth), 0.0)
        if self._ends[1]:
            torque += self._stiffness * max(self._low + depth - angle, 0.0)
        return torque


class Hysteresis(_Torque):
    """Dahl's friction (1968): an elastic torque that gives way, dF/dq = stiffness (1 - sign(v) F / torque)."""

    key = "hysteresis"
    sizes = (1e-4, 2.0)

    def draw(self, random: np.random.Generator) -> None:
        # gives way over a few parts in a hundred of the travel: a way that can be seen, else it is dry friction
        self._way = self.site.span * log_uniform(random, 0.03, 0.2)

    def values(self) -> dict[str, float]:
        most = self.size * self.site.torque
        return {"torque": most, "stiffness": most / self._way}

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._part = 0.0  # of the torque at which it gives way

    def of(self, angle: float, speed: float) -> float:
        way = 1.0 if speed > 0 else -1.0
        self._part = way + (self._part - way) * float(np.exp(-abs(speed) * self.step_s / self._way))
        return -self.size * self.site.torque * self._part


class Coupling(Law):
    """Who moves first on a coupled tendon: a preload and springs at both joints, dry friction at the distal one."""

    key = "coupling"
    at = "pair"
    each_step = True
    sizes = (1e-4, 2.0)

    def draw(self, random: np.random.Generator) -> None:
        kp = self.site.kp
        self._preload, self._distal, self._proximal = (kp * float(random.uniform(0.05, 0.3)) for _ in range(3))
        self._friction = kp * float(random.uniform(0.005, 0.02)) if chance(random, 0.5) else 0.0

    def values(self) -> dict[str, float]:
        return {"preload": self.size * self._preload, "spring_distal": self.size * self._distal,
                "spring_proximal": self.size * self._proximal}  # fmt: skip

    def edit(self, spec: Any) -> None:
        joint = self.joint_of(spec)
        joint.frictionloss = joint.frictionloss + self.size * self._friction

    def step(self, target: np.ndarray) -> None:
        near, far = self.site.robot.servos[self.site.servo].joints
        qpos, applied = self.data.qpos, self.data.qfrc_applied
        applied[far] -= self.size * (self._preload + self._distal * float(qpos[far]))
        applied[near] -= self.size * self._proximal * float(qpos[near])


class Notch(_Torque):
    """A dent at one angle: a torque of two lobes that draws the joint in."""

    key = "x_notch"
    sizes = (1e-3, 3.0)

    def draw(self, random: np.random.Generator) -> None:
        self._centre = float(np.quantile(self.site.angle, random.uniform(0.3, 0.7)))
        self._half = self.site.span * float(random.uniform(0.03, 0.08))

    def of(self, angle: float, speed: float) -> float:
        x = (angle - self._centre) / self._half
        return -self.size * self.site.torque * x * float(np.exp(0.5 * (1 - x * x)))
