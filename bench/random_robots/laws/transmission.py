"""Between the motor and the joint: a gap, a soft shaft, a belt that creeps. The motor side has states of its own."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..dice import chance, log_uniform
from .base import ServoLaw


class _MotorSide(ServoLaw):
    """A motor with its own inertia and damping, which the servo controls; `link` gives what reaches the joint."""

    def draw(self, random: np.random.Generator) -> None:
        self._share = float(random.uniform(0.3, 0.7))

    def edit(self, spec: Any) -> None:
        super().edit(spec)
        robot, servo = self.site.robot, self.site.robot.servos[self.site.servo]
        self._inertia = self._damping = 0.0
        for index in servo.joints:
            joint = spec.joint(robot.joints[index])
            # a tendon's joints share its travel, and so the motor counts with the square of each one's part
            part = self._share / len(servo.joints) ** 2
            damping = np.array(joint.damping, float)
            self._inertia += part * joint.armature
            self._damping += part * damping[0]
            joint.armature = joint.armature * (1 - self._share)
            damping[0] *= 1 - self._share
            joint.damping = damping

    def stiffness(self) -> float:
        """N m/rad of the link where it is tight."""
        raise NotImplementedError

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._angle, self._speed = self.length()
        kp = self._gains[0]
        fastest = np.sqrt((self.stiffness() + kp) / self._inertia)
        self._times = int(np.clip(np.ceil(step_s * fastest / 0.25), 1, 40))
        self._loss = 2 * 0.25 * np.sqrt(self.stiffness() * self._inertia)

    def link(self, twist: float, rate: float) -> float:
        """N m on the joint, for the motor's lead in rad and rad/s."""
        return self.stiffness() * twist + self._loss * rate

    def step(self, target: np.ndarray) -> None:
        angle, speed = self.length()
        told, short = float(target[self.site.servo]), self.step_s / self._times
        motor, turning, total = self._angle, self._speed, 0.0
        for number in range(self._times):
            pull = self.link(motor - (angle + number * short * speed), turning - speed)
            driven = self.torque(told - motor, turning)
            turning += short * (driven - pull - self._damping * turning) / self._inertia
            motor += short * turning
            total += pull
        self._angle, self._speed = motor, turning
        self.pull(total / self._times)


class Backlash(_MotorSide):
    """A motor of its own behind a gap with stiff ends."""

    key = "backlash"
    sizes = (1e-5, 0.4)

    def draw(self, random: np.random.Generator) -> None:
        super().draw(random)
        self._tight = log_uniform(random, 15, 60)

    def values(self) -> dict[str, float]:
        return {"gap": 2 * self.size * self.site.unit}

    def stiffness(self) -> float:
        return self._tight * self.site.kp

    def link(self, twist: float, rate: float) -> float:
        half = self.size * self.site.unit
        if abs(twist) <= half:
            return 0.0
        pull = super().link(twist - half if twist > 0 else twist + half, rate)
        return max(pull, 0.0) if twist > 0 else min(pull, 0.0)


class ServoPlay(ServoLaw):
    """Backlash of a light motor that follows its command at once: the servo's own stiffness behind a gap."""

    key = "backlash"
    sizes = (1e-5, 0.4)

    def values(self) -> dict[str, float]:
        return {"gap": 2 * self.size * self.site.unit}

    def step(self, target: np.ndarray) -> None:
        angle, speed = self.length()
        error = float(target[self.site.servo]) - angle
        left = abs(error) - self.size * self.site.unit
        self.pull(self.torque(np.sign(error) * left, speed) if left > 0 else self.torque(0.0, speed))


class Elasticity(_MotorSide):
    """A soft shaft or tendon; the size is the servo's stiffness over the shaft's."""

    key = "tendon_elasticity"
    sizes = (3e-3, 2.0)

    def values(self) -> dict[str, float]:
        return {"stiffness": self.stiffness()}

    def stiffness(self) -> float:
        return self.site.kp / self.size


class Creep(ServoLaw):
    """A belt that gives way under load in seconds and comes back as slowly; the servo sees its own side of it."""

    key = "x_creep"
    sizes = (3e-3, 1.5)

    def draw(self, random: np.random.Generator) -> None:
        self._slow_s = log_uniform(random, 1.0, 6.0)
        self._both = chance(random, 0.5)  # a second, faster element

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._given = [0.0, 0.0]

    def step(self, target: np.ndarray) -> None:
        angle, speed = self.length()
        torque = self.torque(float(target[self.site.servo]) - angle - sum(self._given), speed)
        most = self.size * torque / self.site.kp
        for number, slow in enumerate((self._slow_s, self._slow_s / 8)[: 1 + self._both]):
            self._given[number] += self.step_s / slow * (most / (1 + number) - self._given[number])
        self.pull(torque)
