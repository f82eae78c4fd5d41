"""The plant of a robot: its bodies are not quite those of the nominal model, its time step is finer, its bus is late.

A plant runs with any number of laws (see `laws`) at work. Times in s, angles in rad (m of a slide), torques in N m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np

from .dice import dice
from .robots import Robot

if TYPE_CHECKING:
    from .laws.base import Law

SETTLE_S = 2.0  # before a motion begins
_PLANT_STEP_S = 0.0005

# What a nominal model is off by: shares of masses, centres and inertias; of damping, friction; of the servos' gain.
MODEL_ERRORS: dict[str, tuple[float, float, float]] = {
    "exact": (0.0, 0.0, 0.0),
    "bodies": (0.05, 0.0, 0.0),
    "values10": (0.05, 0.10, 0.05),
    "values20": (0.05, 0.20, 0.10),
}


@dataclass(frozen=True)
class Clock:
    """How plant steps and samples lie: `per_sample` steps of `step_s` between two samples."""

    step_s: float
    per_sample: int

    @classmethod
    def of(cls, robot: Robot) -> Clock:
        """A step of about half a millisecond, at most half the nominal model's, that divides the period of a sample."""
        period = 1.0 / robot.rate_hz
        per_sample = max(1, int(np.ceil(period / min(_PLANT_STEP_S, robot.step_s / 2) - 1e-9)))
        return cls(period / per_sample, per_sample)


class Plant:
    """A robot that runs. `error` is a key of MODEL_ERRORS; what is off follows from the seed."""

    def __init__(self, robot: Robot, seed: int, error: str = "bodies") -> None:
        self.robot = robot
        self.clock = Clock.of(robot)
        self._seed, self._error = seed, error

    def spec(self) -> Any:
        """The plant before it is compiled, without laws."""
        spec = mujoco.MjSpec.from_string(self.robot.xml)
        spec.option.timestep = self.clock.step_s
        _perturb(spec, self.robot, dice(self._seed, "model error"), *MODEL_ERRORS[self._error])
        return spec

    def run(self, targets: np.ndarray, laws: Sequence[Law] = ()) -> np.ndarray:
        """(n, j) what ideal sensors read at the end of each command's period, for commands (n, a)."""
        spec = self.spec()
        for law in sorted(laws, key=lambda law: law.claims == "servo"):
            law.edit(spec)
        model = spec.compile()
        steps = self._commands(targets, laws)
        data = mujoco.MjData(model)
        _start(model, data, self.robot, targets[0])
        inside = [law for law in laws if law.each_step]
        for law in inside:
            law.begin(model, data, self.clock.step_s)
        angles = self._roll(model, data, steps, inside)
        times = np.arange(1, len(targets) + 1) / self.robot.rate_hz
        for law in laws:
            angles = law.sense(times, angles)
        return angles

    def _commands(self, targets: np.ndarray, laws: Sequence[Law]) -> np.ndarray:
        """(m, a) what arrives at the servos in each plant step, held between commands, late by the bus."""
        clock = self.clock
        steps = arriving(self.robot, targets, clock.step_s, len(targets) * clock.per_sample)
        for law in laws:
            steps = law.commands(steps, clock.step_s)
        return steps

    def _roll(self, model: Any, data: Any, steps: np.ndarray, laws: Sequence[Law]) -> np.ndarray:
        """(n, j): steps through all commands and reads the angles once a sample; the first 2 s only settle."""
        per = self.clock.per_sample
        settle = round(SETTLE_S / self.clock.step_s)
        address = model.jnt_qposadr[: len(self.robot.joints)]
        out = np.empty(((len(steps) - settle) // per, len(address)))
        ctrl, applied = data.ctrl, data.qfrc_applied
        step = mujoco.mj_step
        for index, target in enumerate(steps):
            ctrl[:] = target
            if laws:
                applied[:] = 0.0
                for law in laws:
                    law.step(target)
            step(model, data)
            done = index + 1 - settle
            if done > 0 and done % per == 0:
                out[done // per - 1] = data.qpos[address]
        if not np.isfinite(out).all() or np.abs(out).max() > 1e3 or data.warning.number.any():
            raise Unstable("the plant's angles grow without bound")
        return out


class Unstable(Exception):
    """A plant that blew up: the strength or the robot is not one that could exist."""


def nominal(robot: Robot, targets: np.ndarray, step_s: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """((n, j) angles, (a,) largest torque of each servo): the nominal model's roll-out, with the bus' delay known."""
    model = mujoco.MjModel.from_xml_string(robot.xml)
    if step_s:
        model.opt.timestep = step_s
    step_s = float(model.opt.timestep)
    data = mujoco.MjData(model)
    _start(model, data, robot, targets[0])
    settle, count = round(SETTLE_S / step_s), steps_of(robot, targets, step_s)
    angles, peaks = np.empty((count, len(robot.joints))), np.zeros(model.nu)
    touched = False
    for number, row in enumerate(arriving(robot, targets, step_s, count)):
        data.ctrl[:] = row
        mujoco.mj_step(model, data)
        if number >= settle:
            angles[number - settle] = data.qpos
            np.maximum(peaks, np.abs(data.actuator_force), out=peaks)
            touched = touched or data.ncon > 0
    if touched:
        raise Touching("links touch")
    if not np.isfinite(angles).all() or np.abs(angles).max() > 1e3:
        raise Unstable("the nominal model blows up")
    return at_samples(robot, len(targets), angles, step_s), peaks


def steps_of(robot: Robot, targets: np.ndarray, step_s: float) -> int:
    """How many steps last as long as the commands (n, a)."""
    return int(np.ceil(len(targets) / robot.rate_hz / step_s)) + 1


def arriving(robot: Robot, targets: np.ndarray, step_s: float, count: int) -> np.ndarray:
    """(m, a) what arrives at the servos in each step, held between commands (n, a), late by the bus.

    `count` steps of motion, and before them those in which the robot settles.
    """
    late = (np.arange(-round(SETTLE_S / step_s), count) + 0.5) * step_s - robot.delay_s
    return targets[np.clip(np.floor(late * robot.rate_hz).astype(int), 0, len(targets) - 1)]


def at_samples(robot: Robot, samples: int, angles: np.ndarray, step_s: float) -> np.ndarray:
    """Angles (m, j) at the end of each step of a motion -> those at its samples (n, j)."""
    when = np.arange(1, samples + 1) / robot.rate_hz
    stamps = np.arange(1, len(angles) + 1) * step_s
    return np.column_stack([np.interp(when, stamps, column) for column in angles.T])


class Touching(Exception):
    """The nominal motion makes links collide."""


def measured(robot: Robot, angles: np.ndarray, seed: int, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """((n,) stamps in s, (n, j) readings): noise, resolution and jitter on what ideal sensors would say."""
    random = dice(seed, f"noise {kind}")
    noisy = angles + robot.noise * random.standard_normal(angles.shape)
    stamps = np.arange(1, len(angles) + 1) / robot.rate_hz + robot.jitter_s * random.standard_normal(len(angles))
    return np.maximum.accumulate(stamps), np.round(noisy / robot.resolution) * robot.resolution


def _start(model: Any, data: Any, robot: Robot, targets: np.ndarray) -> None:
    """Joints at their targets; those of a pair share its target."""
    for servo, target in zip(robot.servos, targets, strict=True):
        for joint in servo.joints:
            data.qpos[joint] = target / len(servo.joints)
    mujoco.mj_forward(model, data)


def _perturb(spec: Any, robot: Robot, random: np.random.Generator, bodies: float, joints: float, gain: float) -> None:
    """Bodies off by up to `bodies`, damping and friction by up to `joints`, servos by up to `gain` (shares)."""
    for link in robot.tree.links:
        body = spec.body(f"{link.joint}_link")
        mass, *inertia = 1 + bodies * random.uniform(-1, 1, 4)
        body.mass = body.mass * mass
        body.inertia = np.asarray(body.inertia) * (mass * (1 + (np.array(inertia) - 1) / 2))
        body.ipos = np.asarray(body.ipos) * (1 + bodies * random.uniform(-1, 1, 3))
        joint = spec.joint(link.joint)
        damping, friction = 1 + joints * random.uniform(-1, 1, 2)
        joint.damping = np.asarray(joint.damping) * damping
        joint.frictionloss = joint.frictionloss * friction
    for servo in robot.servos:
        actuator = spec.actuator(servo.actuator)
        factor = 1 + gain * float(random.uniform(-1, 1))
        actuator.gainprm[0] *= factor
        actuator.biasprm[1:3] = np.asarray(actuator.biasprm[1:3]) * factor
