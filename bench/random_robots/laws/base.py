"""What every law of a plant is: the seams where it may act, how strong it is, and the place that gives its scales."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..robots import Robot


@dataclass(frozen=True)
class Site:
    """A place on a robot and what the nominal robot does there. Angles in rad (m of a slide), torques in N m (N)."""

    robot: Robot
    joint: int  # index among the joints; of a tendon the distal one
    servo: int  # index among the servos
    angle: np.ndarray  # (n,) of the joint in the nominal motion
    command: np.ndarray  # (n,) of the servo
    peak: float  # largest torque of the servo in that motion
    others: np.ndarray  # (n, j) angles of all joints

    @property
    def kp(self) -> float:
        return self.robot.servos[self.servo].kp

    @property
    def kv(self) -> float:
        return self.robot.servos[self.servo].kv

    @property
    def unit(self) -> float:
        """What counts as one radian: 0.1 m of a slide."""
        return 0.1 if self.robot.tree.links[self.joint].slide else 1.0

    @property
    def inertia(self) -> float:
        return float(self.robot.inertia[self.joint])

    @property
    def torque(self) -> float:
        """The torque scale of the place: gravity's, or what moves the servo by 30 mrad."""
        return max(float(self.robot.gravity_load[self.joint]), 0.03 * self.kp * self.unit)

    @property
    def span(self) -> float:
        return float(np.ptp(self.angle))

    @property
    def speed(self) -> float:
        """Rms speed of the joint in rad/s."""
        return float(np.sqrt(np.mean(np.square(np.diff(self.angle)))) * self.robot.rate_hz)

    @property
    def fastest(self) -> float:
        """Largest speed of the command in rad/s."""
        return float(np.abs(np.diff(self.command)).max() * self.robot.rate_hz)


class Law:
    """One mechanism at one site. `size` says how strong it is, in its own unit; subclasses override their seams."""

    key: ClassVar[str]
    at: ClassVar[str] = "joint"
    """joint: any measured joint; servo: a servo; lone: a joint with a servo of its own; pair: a coupled tendon."""
    sizes: ClassVar[tuple[float, float]] = (1e-3, 10.0)
    """Smallest and largest size that a robot could have."""
    each_step: ClassVar[bool] = False
    """Whether `step` is called in each step of the plant."""
    composed: ClassVar[tuple[tuple[str, ...], ...]] = ()
    """Of a law of no library: effects that together are the same law in position data, each by its names."""
    claims: ClassVar[str] = ""
    """What only one law at a servo may take over: "servo" or "friction"."""

    @property
    def foreign(self) -> bool:
        """Whether no library has the law."""
        return self.key.startswith("x_")

    def __init__(self, site: Site, random: np.random.Generator) -> None:
        self.site = site
        self.size = 1.0
        self.draw(random)

    def draw(self, random: np.random.Generator) -> None:
        """Draws signs and shapes; what is left is the size."""

    def values(self) -> dict[str, float]:
        """Numbers that a diagnosis may be held to, by the contract's names, in SI units."""
        return {}

    def nominal_change(self) -> float | None:
        """What it does to a number of the model of which nobody knows the exact value, in natural logarithms.

        None where it does what no such number does.
        """
        return None

    def edit(self, spec: Any) -> None:
        """Changes the plant before it is compiled."""

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        """Takes hold of a plant whose steps begin; forgets the past."""
        self.model, self.data, self.step_s = model, data, step_s

    def step(self, target: np.ndarray) -> None:
        """Adds torques for one step; `target` (a,) is what the servos are told."""

    def commands(self, steps: np.ndarray, step_s: float) -> np.ndarray:
        """(m, a) what arrives at the servos, from what was sent."""
        return steps

    def sense(self, times: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """(n, j) what ideal sensors read, from the joints' angles."""
        return angles

    @property
    def places(self) -> tuple[str, ...]:
        """Names in the data under which the place may be reported: for a tendon its command and both joints."""
        robot = self.site.robot
        if self.at in ("servo", "pair"):
            servo = robot.servos[self.site.servo]
            names = [robot.joints[index] for index in servo.joints]
            return tuple(dict.fromkeys([*names, servo.command]))
        return (robot.joints[self.site.joint],)

    def joint_of(self, spec: Any) -> Any:
        return spec.joint(self.site.robot.joints[self.site.joint])

    def actuator_of(self, spec: Any) -> Any:
        return spec.actuator(self.site.robot.servos[self.site.servo].actuator)


def change(of: float, by: float) -> float | None:
    """|ln| of what a number of the model becomes; None where the model has none."""
    return abs(float(np.log(max(of + by, 1e-9 * of) / of))) if of > 0 else None


class ServoLaw(Law):
    """A law that computes the servo's torque itself, in the place of MuJoCo's; edited after all others of the servo."""

    at = "servo"
    each_step = True
    claims = "servo"

    def edit(self, spec: Any) -> None:
        actuator = self.actuator_of(spec)
        self._gains = float(actuator.gainprm[0]), -float(actuator.biasprm[2])
        self._limit = float(actuator.forcerange[1]) or np.inf
        actuator.gainprm[0] = 0.0
        actuator.biasprm[1:3] = 0.0

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._joints = list(self.site.robot.servos[self.site.servo].joints)

    def length(self) -> tuple[float, float]:
        """(angle, speed) of the joint, or of the tendon: the sum of its joints."""
        qpos, qvel = self.data.qpos, self.data.qvel
        angle = speed = 0.0
        for joint in self._joints:
            angle += float(qpos[joint])
            speed += float(qvel[joint])
        return angle, speed

    def torque(self, error: float, speed: float) -> float:
        """The servo's own law, with its limit."""
        kp, kv = self._gains
        return min(max(kp * error - kv * speed, -self._limit), self._limit)

    def pull(self, torque: float) -> None:
        for joint in self._joints:
            self.data.qfrc_applied[joint] += torque
