"""Reading an MJCF: it must compile, be physically possible, and name its joints and servos."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.hand.mjcf_screen import screen_mjcf

_ONE_DOF = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
_ON_JOINTS = (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT)


@dataclass(frozen=True)
class Servo:
    """An actuator that follows a position target: the joints it moves (with their weights) and the targets it takes."""

    name: str
    joints: tuple[str, ...]
    weights: tuple[float, ...]
    range_rad: tuple[float, float]  # infinite where neither the actuator nor its joints are limited


@dataclass(frozen=True)
class ModelNames:
    """What an MJCF offers: its named 1-dof joints with their ranges (infinite where unlimited) and its servos."""

    name: str
    joint_range_rad: dict[str, tuple[float, float]]
    servos: dict[str, Servo]
    slides: frozenset[str] = frozenset()
    """Joints that slide: their ranges are in m."""


def compile_model(path: Path) -> mujoco.MjModel:
    """The model of `path`. BadInput where it is missing, does not compile, or is not physical."""
    if not path.is_file():
        raise BadInput("no such model file", where=path, todo="Give the path of an MJCF (.xml)")
    screen_mjcf(path)
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, OSError, mujoco.FatalError) as error:
        raise BadInput(f"MuJoCo cannot compile this model: {error}", where=path, todo="Correct the MJCF") from error
    refuse_unphysical(model, path)
    return model


def refuse_unphysical(model: mujoco.MjModel, where: Path | str | None = None) -> None:
    """BadInput for negative or undefined damping, friction, stiffness, armature or mass, naming the joint.

    MuJoCo compiles these silently, and the model then creates energy.
    """
    dof_joint = [model.joint(int(index)).name or f"joint {int(index)}" for index in model.dof_jntid]
    joints = [model.joint(index).name or f"joint {index}" for index in range(model.njnt)]
    tendons = [model.tendon(index).name or f"tendon {index}" for index in range(model.ntendon)]
    bodies = [model.body(index).name or f"body {index}" for index in range(model.nbody)]
    checks: tuple[tuple[str, str, Sequence[str], np.ndarray], ...] = (
        ("joint", "damping", dof_joint, model.dof_damping),
        ("joint", "frictionloss", dof_joint, model.dof_frictionloss),
        ("joint", "armature", dof_joint, model.dof_armature),
        ("joint", "stiffness", joints, model.jnt_stiffness),
        ("tendon", "damping", tendons, model.tendon_damping),
        ("tendon", "frictionloss", tendons, model.tendon_frictionloss),
        ("tendon", "stiffness", tendons, model.tendon_stiffness),
        ("body", "mass", bodies, model.body_mass),
    )
    for kind, quantity, names, values in checks:
        wrong = np.flatnonzero(~(values >= 0.0) | np.isinf(values))
        if wrong.size:
            index = int(wrong[0])
            raise BadInput(
                f"{kind} '{names[index]}' has {quantity} {values[index]:g}",
                where=where,
                allowed="finite, 0 or more: a negative one creates energy",
                todo="Correct the MJCF",
            )


def read_names(model: mujoco.MjModel, name: str) -> ModelNames:
    """Names and ranges of the 1-dof joints and position servos of `model`; `name` is used if it names none itself.

    Ball and free joints, joints without a name, and actuators that are no position servos (motors, muscles) or act on
    something else than joints and tendons are left out.
    """
    ranges: dict[str, tuple[float, float]] = {}
    for index in range(model.njnt):
        joint = model.joint(index)
        if joint.name and int(model.jnt_type[index]) in _ONE_DOF:
            limited = bool(model.jnt_limited[index])
            low, high = model.jnt_range[index] if limited else (-math.inf, math.inf)
            ranges[joint.name] = (float(low), float(high))
    slides = frozenset(
        joint for joint in ranges if int(model.jnt_type[model.joint(joint).id]) == mujoco.mjtJoint.mjJNT_SLIDE
    )
    servos: dict[str, Servo] = {}
    for index in range(model.nu):
        servo = _servo(model, index, ranges)
        if servo is not None:
            servos[servo.name] = servo
    return ModelNames(name=name, joint_range_rad=ranges, servos=servos, slides=slides)


def _servo(model: mujoco.MjModel, index: int, ranges: dict[str, tuple[float, float]]) -> Servo | None:
    actuator = model.actuator(index)
    driven = _driven(model, index)
    if not actuator.name or not driven or not _follows_position(model, index):
        return None
    if any(joint not in ranges for joint, _ in driven):
        return None
    if model.actuator_ctrllimited[index]:
        low, high = (float(value) for value in model.actuator_ctrlrange[index])
    else:
        ends = [sorted((weight * ranges[joint][0], weight * ranges[joint][1])) for joint, weight in driven]
        low, high = sum(end[0] for end in ends), sum(end[1] for end in ends)
    return Servo(
        name=actuator.name,
        joints=tuple(joint for joint, _ in driven),
        weights=tuple(weight for _, weight in driven),
        range_rad=(low, high),
    )


def _follows_position(model: mujoco.MjModel, index: int) -> bool:
    """True where the force pulls back from the actuator's length: position and PID servos do, motors do not."""
    affine = int(model.actuator_biastype[index]) == mujoco.mjtBias.mjBIAS_AFFINE
    return affine and float(model.actuator_biasprm[index][1]) < 0.0


def _driven(model: mujoco.MjModel, index: int) -> list[tuple[str, float]]:
    """(joint, weight) pairs that the actuator moves: length = sum(weight * joint). Empty for other transmissions."""
    kind, target = int(model.actuator_trntype[index]), int(model.actuator_trnid[index][0])
    if kind in _ON_JOINTS:
        return [(model.joint(target).name, float(model.actuator_gear[index][0]))]
    if kind != mujoco.mjtTrn.mjTRN_TENDON:
        return []
    first = int(model.tendon_adr[target])
    wraps = range(first, first + int(model.tendon_num[target]))
    if any(int(model.wrap_type[wrap]) != mujoco.mjtWrap.mjWRAP_JOINT for wrap in wraps):
        return []  # a spatial tendon: its length is no sum of joint angles
    return [(model.joint(int(model.wrap_objid[wrap])).name, float(model.wrap_prm[wrap])) for wrap in wraps]
