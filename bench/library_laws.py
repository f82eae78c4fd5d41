"""The library's effects at the elbow of a small arm, by laws written apart from it (`bench.random_robots.laws`).

Each moves the elbow by 12 mrad rms. One that changes what a model says anyway changes that by a factor of e, and a late
command is 40 ms late: eight standard deviations of what is uncertain about any model, which asks for no law. `ANSWERS`
says by physics which ports and variables a law has: what a proposal should name where the library does not know the
effect. `coupling` is left out: it splits one tendon between two joints, and here every joint has its own servo.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from bench.foreign_laws import JOINTS, KP, NOISE_RAD, RATE_HZ, targets
from bench.random_robots.dice import dice
from bench.random_robots.laws import LIBRARY, Law, Site
from bench.random_robots.plants import Plant, Unstable, nominal
from bench.random_robots.robots import Robot, Servo, mjcf
from bench.random_robots.trees import Link, Tree

_ELBOW = JOINTS.index("elbow")
_WANTED_RAD = 0.012
_HALVINGS = 9
_LEAST_CHANGE = 1.0
_LEAST_LATE_S = 0.04
_LENGTH_M, _MASS_KG = 0.2, 0.2  # of the forearm
_RADIUS_M = 0.04

_GRAVITY = (("torque", "orientation"), ("torque", "position"), ("torque", "shoulder"))
_FRICTION = (("torque", "velocity"), ("torque", "direction"))
_LATE = (("command", "command_rate"),)
ANSWERS: dict[str, tuple[tuple[str, str], ...]] = {
    "viscous_friction": _FRICTION,
    "coulomb_friction": _FRICTION,
    "stribeck_friction": _FRICTION,
    # a brake that the servo's torque presses
    "load_friction": (("torque", "load"),),
    # a servo behind a gap gives nothing while its error is inside; a motor of its own turns through it first
    "backlash": (("command", "error"), ("command", "command")),
    # elastic up to a yield, then constant until the next reversal: play
    "hysteresis": (("torque", "velocity"), ("torque", "direction")),
    # two springs in series: the servo's slope over its error falls, and its motor swings
    "tendon_elasticity": (("command", "error"),),
    "spring": (("torque", "position"),),
    "nonlinear_spring": (("torque", "position"),),
    "joint_stop": (("torque", "position"),),
    "armature": (("torque", "acceleration"),),
    # weight over both angles, and inertia
    "payload": (*_GRAVITY, ("torque", "acceleration")),
    "gravity_tilt": _GRAVITY,
    "actuator_gain": (("command", "error"),),
    "actuator_saturation": (("command", "error"),),
    # what arrives is late by a time: it differs from what was sent while that changes
    "actuator_lag": _LATE,
    "rate_limit": _LATE,
    "command_delay": _LATE,
    "torque_ripple": (("torque", "position"),),
    "sensor_offset": (("reading", "position"),),
    "sensor_gain": (("reading", "position"),),
    "dead_zone": (("command", "error"),),
}
"""(port, variable) that a proposal should name, any one of them."""


@cache
def _robot() -> Robot:
    """The small arm of `foreign_laws`, as the laws of the random robots ask for it."""
    links = []
    for name, parent, at, length, mass in (
        ("shoulder", -1, (0, 0, 1), 0.25, 0.3),
        ("elbow", 0, (0.25, 0, 0), _LENGTH_M, _MASS_KG),
    ):
        across = mass * (3 * _RADIUS_M**2 + length**2) / 12
        middle, inertia = (length / 2, 0.0, 0.0), (mass * _RADIUS_M**2 / 2, across, across)
        links.append(Link(name, parent, at, (0, 1, 0), -2.0, 2.0, mass, middle, inertia, (length, 0, 0), _RADIUS_M))
    servos = tuple(Servo(name, name, (index,), KP[name], 0.0, -2.0, 2.0) for index, name in enumerate(JOINTS))
    weight = 9.81 * np.array([0.3 * 0.125 + _MASS_KG * 0.35, _MASS_KG * 0.1])
    felt = np.array([0.3 * 0.25**2 / 3 + _MASS_KG * 0.35**2, _MASS_KG * _LENGTH_M**2 / 3])
    armature = np.array([0.01, 0.006])
    return Robot(
        tree=Tree("arm", tuple(links), (), (1.0, 0.0, 0.0, 0.0)), servos=servos, armature=armature,
        damping=np.array([0.6, 0.25]), friction=np.array([0.05, 0.03]), stiffness=np.zeros(2), gravity_load=weight,
        inertia=felt + armature, noise=np.full(2, NOISE_RAD), resolution=np.full(2, 1e-6), bandwidth_hz=4.5,
        rate_hz=float(RATE_HZ), jitter_s=0.0, delay_s=0.0, step_s=0.002, integrator="implicitfast", contacts=False,
    )  # fmt: skip


def library_model(folder: Path) -> Path:
    """Writes the nominal arm and returns its file."""
    path = folder / "library_arm.xml"
    path.write_text(mjcf(_robot()), encoding="utf-8")
    return path


def record_pair(key: str, paths: tuple[Path, Path], *, seconds: tuple[float, float], seed: int) -> None:
    """Writes the arm with an effect at its elbow: motion to fit, and other motion half again as fast.

    Bodies, damping, friction and gain are off as in `values10` of the random robots.
    """
    robot = _robot()
    plant = Plant(robot, seed, "values10")
    wanted = [targets(seconds[0], seed)[1], targets(seconds[1], 100 + seed, 1.5)[1]]
    angles, peaks = nominal(robot, wanted[0])
    site = Site(robot, _ELBOW, _ELBOW, angles[:, _ELBOW], wanted[0][:, _ELBOW], float(peaks[_ELBOW]), angles)
    kinds = next(kinds for kinds in LIBRARY if kinds[0].key == key)
    law = kinds[seed % len(kinds)](site, dice(seed, "law"))
    sound = plant.run(wanted[0])
    _as_strong(law, lambda: _moved(plant, law, wanted[0], sound))
    for path, commands, number in zip(paths, wanted, (0, 1), strict=True):
        _write(path, commands, plant.run(commands, [law]), np.random.default_rng([seed, number]))


def _moved(plant: Plant, law: Law, wanted: np.ndarray, sound: np.ndarray) -> float:
    try:
        difference = plant.run(wanted, [law]) - sound
    except Unstable:
        return np.inf
    return float(np.sqrt(np.mean(difference[:, _ELBOW] ** 2)))


def _as_strong(law: Law, moved: Callable[[], float]) -> None:
    """Sets the size at which the elbow is moved by as much as is wanted: it grows with the size."""
    low, high = np.log(law.sizes)
    for _ in range(_HALVINGS):
        law.size = float(np.exp(0.5 * (low + high)))
        if moved() < _WANTED_RAD or not _beyond_belief(law):
            low = np.log(law.size)
        else:
            high = np.log(law.size)
    law.size = float(np.exp(high))


def _beyond_belief(law: Law) -> bool:
    change, values = law.nominal_change(), law.values()
    if law.key == "tendon_elasticity":  # in series with the servo, it makes it weaker by this
        change = float(np.log1p(law.size))
    if law.key == "payload":  # at the link's end: a weaker servo sags as much under the same weight
        change = float(np.log1p(values["mass"] * _LENGTH_M / (_MASS_KG * 0.5 * _LENGTH_M)))
    late = values.get("delay", values.get("tau", _LEAST_LATE_S))
    return late >= _LEAST_LATE_S and (change is None or change >= _LEAST_CHANGE)


def _write(path: Path, commands: np.ndarray, angles: np.ndarray, random: np.random.Generator) -> None:
    from twin_daemon.recordings.writer import McapWriter

    begin_ns, period_ns = 1_700_000_000_000_000_000, round(1e9 / RATE_HZ)
    with McapWriter(path) as bag:
        for index, (target, angle) in enumerate(zip(commands, angles, strict=True)):
            bag.joint_commands(begin_ns + index * period_ns, JOINTS, target)
            read = angle + NOISE_RAD * random.standard_normal(len(JOINTS))
            # read at the end of the command's period
            bag.joint_states(begin_ns + (index + 1) * period_ns - 1000, JOINTS, read)
