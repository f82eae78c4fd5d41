"""A whole robot: servos, friction and sensors that fit its tree, and the nominal MJCF that its user has.

Scales follow from the tree: what gravity asks of each servo and the inertia that it feels. A servo is as stiff as a
sag of some mrad asks for; reflected rotor inertia then gives it the drawn bandwidth (1 to 10 Hz).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from .dice import chance, dice, log_uniform, pick
from .trees import KINDS, Link, Tree, draw_tree

_SLIDE_UNIT_M = 0.1
"""How many metres of a slide count as one radian where a scale is drawn."""


@dataclass(frozen=True)
class Servo:
    """A position servo. `joints` are one index, or the two of a coupled tendon; gains in N m/rad (N/m), N m s/rad."""

    command: str
    actuator: str
    joints: tuple[int, ...]
    kp: float
    kv: float
    low: float
    high: float
    limit: float | None = None  # N m or N, either way


@dataclass(frozen=True)
class Robot:
    """What a case is made of. Arrays are by joint (j,), in the order of the MJCF."""

    tree: Tree
    servos: tuple[Servo, ...]
    armature: np.ndarray  # kg m2
    damping: np.ndarray  # N m s/rad
    friction: np.ndarray  # N m
    stiffness: np.ndarray  # N m/rad
    gravity_load: np.ndarray  # N m, the largest that gravity asks for
    inertia: np.ndarray  # kg m2, felt at the joint, armature included
    noise: np.ndarray  # rad (m), one sigma
    resolution: np.ndarray  # rad (m)
    bandwidth_hz: float
    rate_hz: float
    jitter_s: float
    delay_s: float
    step_s: float
    integrator: str
    contacts: bool

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(link.joint for link in self.tree.links)

    @property
    def commands(self) -> tuple[str, ...]:
        return tuple(servo.command for servo in self.servos)

    @property
    def xml(self) -> str:
        """The nominal MJCF, as its user has it."""
        return mjcf(self)

    def servo_of(self, joint: int) -> int:
        """Index of the servo that moves the joint."""
        return next(index for index, servo in enumerate(self.servos) if joint in servo.joints)

    def floor(self) -> np.ndarray:
        """(j,) rad: what noise and resolution leave, rms."""
        return np.hypot(self.noise, self.resolution / np.sqrt(12))


def draw_robot(seed: int, kind: str | None = None, pair: bool | None = None) -> Robot:
    """The robot of a seed, without limits on its servos' torque: those follow from its motion."""
    random = dice(seed, "robot")
    tree = draw_tree(random, kind or pick(random, KINDS), pair)
    count = len(tree.links)
    gravity, inertia, both = _scales(tree)
    unit = np.array([_SLIDE_UNIT_M if link.slide else 1.0 for link in tree.links])
    bandwidth = log_uniform(random, 1.0, 6.0) if tree.kind in ("arm", "gantry") else log_uniform(random, 2.5, 10.0)
    sag, ratio = log_uniform(random, 0.004, 0.08), log_uniform(random, 0.3, 2.0)
    rotor = log_uniform(random, 0.02, 0.2) if chance(random, 0.3) else log_uniform(random, 0.3, 3.0)
    dry = 0.0 if chance(random, 0.15) else log_uniform(random, 0.005, 0.06)
    by_servo = log_uniform(random, 0.1, 0.8) if chance(random, 0.35) else 0.0
    naming = pick(random, ("{}", "A_{}"))
    armature, damping, friction, stiffness = (np.zeros(count) for _ in range(4))
    servos = []
    coupled = {index for _, near, far in tree.pairs for index in (near, far)}
    for index in range(count):
        if index in coupled:
            continue
        one = _Servo.drawn(random, inertia[index], gravity[index], bandwidth, sag * unit[index], rotor, ratio)
        armature[index] = one.armature
        damping[index], kv = one.damping * (1 - by_servo), one.damping * by_servo
        friction[index] = dry * max(gravity[index], one.kp * 0.03 * unit[index]) * random.uniform(0.5, 1.5)
        link = tree.links[index]
        servos.append(
            Servo(link.joint, naming.format(link.joint), (index,), _round(one.kp), _round(kv), link.low, link.high)
        )
    for command, near, far in tree.pairs:
        load = float(max(gravity[near], gravity[far]))
        one = _Servo.drawn(random, both[near], load, bandwidth, sag, rotor, ratio)
        spring = max(log_uniform(random, 0.05, 0.3) * one.kp, load / 0.3) if chance(random, 0.8) else 0.0
        for index in (near, far):
            armature[index] = max(2 * one.armature, rotor * inertia[index])
            felt = inertia[index] + armature[index]
            damping[index] = ratio * np.sqrt(one.kp * felt) * random.uniform(0.8, 1.2)
            friction[index] = (dry or 0.01) * max(load, one.kp * 0.03) * random.uniform(0.5, 1.5)
            stiffness[index] = spring * random.uniform(0.7, 1.3)
        high = tree.links[near].high + tree.links[far].high
        servos.append(Servo(command, naming.format(command), (near, far), _round(one.kp), 0.0, 0.0, high))
    fields = {"armature": armature, "damping": damping, "friction": friction, "stiffness": stiffness}
    rounded = {name: np.array([_round(v) for v in values]) for name, values in fields.items()}
    return Robot(
        tree=tree, servos=tuple(servos), **rounded, gravity_load=gravity, inertia=inertia + armature,
        bandwidth_hz=bandwidth, **_sensing(seed, unit), **_numerics(seed, tree),
    )  # fmt: skip


def with_limits(robot: Robot, peaks: np.ndarray, seed: int) -> Robot:
    """The robot with torque limits above `peaks` (a,) N m, what the servos gave in their nominal motions."""
    random = dice(seed, "limits")
    room = random.uniform(1.3, 3.0, len(peaks))
    bounded = [
        replace(servo, limit=_round(float(peak * factor) + 1e-9))
        for servo, peak, factor in zip(robot.servos, peaks, room, strict=True)
    ]
    return replace(robot, servos=tuple(bounded))


@dataclass(frozen=True)
class _Servo:
    kp: float
    damping: float
    armature: float

    @classmethod
    def drawn(
        cls, random: np.random.Generator, inertia: float, load: float, bandwidth: float, sag: float, rotor: float,
        ratio: float,
    ) -> _Servo:  # fmt: skip
        """Stiff enough for the load, with the rotor inertia that leaves it the bandwidth."""
        speed = 2 * np.pi * min(bandwidth * random.uniform(0.8, 1.25), 11.0)
        kp = max(inertia * (1 + rotor) * speed**2, load / (sag * random.uniform(0.7, 1.4)))
        armature = max(kp / speed**2 - inertia, 0.02 * inertia)
        damping = 2 * ratio * random.uniform(0.8, 1.25) * np.sqrt(kp * (inertia + armature))
        return cls(float(kp), float(damping), float(armature))


def _scales(tree: Tree) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(j,) each: the largest torque of gravity, the mean inertia felt, and the same along a pair's tendon."""
    nothing = np.zeros(len(tree.links))
    bare = Robot(
        tree, (), nothing, nothing, nothing, nothing, nothing, nothing, nothing, nothing, 1.0, 100.0, 0.0, 0.0, 0.002,
        "Euler", False,
    )  # fmt: skip
    model = mujoco.MjModel.from_xml_string(mjcf(bare))
    data = mujoco.MjData(model)
    random = np.random.default_rng(0)
    low, high = model.jnt_range.T
    # a roll about a link's own axis carries what is held aside of it
    own = np.array([0.0 if link.slide else 0.05 * 9.81 * link.mass * np.linalg.norm(link.tip) for link in tree.links])
    loads, felt, both = [], [], []
    matrix = np.zeros((model.nv, model.nv))
    for share in random.uniform(0.1, 0.9, (40, model.nq)):
        data.qpos[:] = low + share * (high - low)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, matrix)
        loads.append(np.maximum(np.abs(data.qfrc_bias), own))
        felt.append(np.diag(matrix).copy())
        along = np.zeros(model.nv)
        for _, near, far in tree.pairs:
            along[near] = (matrix[near, near] + 2 * matrix[near, far] + matrix[far, far]) / 4
        both.append(along)
    return np.max(loads, axis=0), np.mean(felt, axis=0), np.mean(both, axis=0)


def _sensing(seed: int, unit: np.ndarray) -> dict[str, Any]:
    """Noise, resolution, rate, jitter and delay: by log-uniform draws."""
    random = dice(seed, "sensors")
    noise = log_uniform(random, 1e-5, 3e-3) * unit * random.uniform(0.8, 1.25, len(unit))
    step = log_uniform(random, 0.3, 4.0) * noise.mean() / unit.mean() * unit
    rate = pick(random, (50.0, 100.0, 125.0, 200.0, 250.0, 500.0, 1000.0))
    period = 1.0 / rate
    return {
        "noise": noise, "resolution": step, "rate_hz": rate,
        "jitter_s": min(log_uniform(random, 1e-5, 1e-3), 0.15 * period),
        "delay_s": min(log_uniform(random, 1e-4, 5e-3), period),
    }  # fmt: skip


def _numerics(seed: int, tree: Tree) -> dict[str, Any]:
    random = dice(seed, "numerics")
    return {
        "step_s": pick(random, (0.001, 0.002, 0.002, 0.004)),
        "integrator": pick(random, ("Euler", "Euler", "implicitfast", "implicit", "RK4")),
        "contacts": tree.kind in ("finger", "hand") and chance(random, 0.4),
    }


def mjcf(robot: Robot) -> str:
    """The MJCF as text: what the nominal model and, before it is made worse, the plant are compiled from."""
    tree = robot.tree
    children: dict[int, list[int]] = {}
    for index, link in enumerate(tree.links):
        children.setdefault(link.parent, []).append(index)
    lines = [
        f'<mujoco model="{tree.kind}">',
        '<compiler angle="radian" autolimits="true"/>',
        f'<option timestep="{robot.step_s:g}" integrator="{robot.integrator}"/>',
        "<worldbody>",
        f'<body name="base" quat="{_numbers(tree.base)}">',
    ]
    for root in children.get(-1, []):
        lines += _body(robot, root, children)
    lines += ["</body>", "</worldbody>"]
    if tree.pairs:
        lines.append("<tendon>")
        for command, near, far in tree.pairs:
            both = "".join(f'<joint joint="{tree.links[index].joint}" coef="1"/>' for index in (near, far))
            lines.append(f'<fixed name="T_{command}">{both}</fixed>')
        lines.append("</tendon>")
    lines.append("<actuator>")
    for servo in robot.servos:
        single = len(servo.joints) == 1
        at = f'joint="{tree.links[servo.joints[0]].joint}"' if single else f'tendon="T_{servo.command}"'
        limit = "" if servo.limit is None else f' forcerange="{-servo.limit:.6g} {servo.limit:.6g}"'
        kv = f' kv="{servo.kv:.6g}"' if servo.kv else ""
        ends = f'ctrlrange="{servo.low:.6g} {servo.high:.6g}"'
        lines.append(f'<position name="{servo.actuator}" {at} kp="{servo.kp:.6g}"{kv} {ends}{limit}/>')
    return "\n".join([*lines, "</actuator>", "</mujoco>"]) + "\n"


def _body(robot: Robot, index: int, children: dict[int, list[int]]) -> list[str]:
    link = robot.tree.links[index]
    touch = "" if robot.contacts else ' contype="0" conaffinity="0"'
    kind = ' type="slide"' if link.slide else ""
    terms = {"damping": robot.damping, "armature": robot.armature, "frictionloss": robot.friction,
             "stiffness": robot.stiffness}  # fmt: skip
    given = "".join(f' {name}="{values[index]:.6g}"' for name, values in terms.items() if values[index])
    ends = f"{link.low:.6g} {link.high:.6g}"
    lines = [
        f'<body name="{link.joint}_link" pos="{_numbers(link.position)}">',
        f'<inertial mass="{link.mass:.6g}" pos="{_numbers(link.centre)}" diaginertia="{_numbers(link.inertia)}"/>',
        f'<joint name="{link.joint}"{kind} axis="{_numbers(link.axis)}" range="{ends}"{given}/>',
        f'<geom type="capsule" size="{link.radius:.6g}" fromto="{_numbers(_drawn(link))}"{touch}/>',
    ]
    for child in children.get(index, []):
        lines += _body(robot, child, children)
    return [*lines, "</body>"]


def _drawn(link: Link) -> tuple[float, ...]:
    """Ends of the capsule, with its round caps inside the link."""
    length = float(np.linalg.norm(link.tip))
    cap = min(link.radius / max(length, 1e-9), 0.4)
    return tuple(cap * v for v in link.tip) + tuple((1 - cap) * v for v in link.tip)


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def _round(value: float) -> float:
    """To three digits, as numbers in a description are."""
    return float(f"{value:.3g}")
