"""A motor with a side of its own: a joint for the motor, and a link from it to what it drives.

The link is a constraint on a fixed tendon `motor - driven`, whose reference acceleration and softness are set so
that MuJoCo's solver computes one implicit Euler step of a spring and damper. Such a link has the stiffness it is
given, in N m/rad, and is stable at any stiffness and time step, which a spring of the same stiffness is not.

A share of the joint's armature and damping moves to the motor, so that the whole is what it was. Where the motor
drives the sum of two joints, their difference gets as much on a tendon of its own, for the same reason.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Parameter, Place, link_tendon, motor_joint
from twin_daemon.effects.edits import keep_softness, linear

_HARDLY = 1e-9  # N m s/rad: stands for none where a law has to be written
_NO_STIFFNESS = 1e-12  # 1/s2: a constraint's law is given by its stiffness and damping where both are below 0
_SMALLEST = 1e-6  # kg m2: a motor with less would not be a body to MuJoCo
OVERLAP = 5e-4
"""rad or m: so early begin the ends of a gap, so that a closed one is held from both sides at once."""
_OPENS = 1e-5  # rad or m: a gap of ten times this is open, and as wide as it says
_CLOSED = 1e-9  # rad or m: MuJoCo wants an upper limit above the lower one


@dataclass(frozen=True)
class Link:
    """The fixed tendon between a motor and what it drives, by name. `made` says that this call has added it."""

    tendon: str
    made: bool


def pulled_joints(spec: Any, actuator: Any) -> dict[str, float]:
    """The joints {name: coefficient} whose weighted sum an actuator pulls, through a tendon or directly."""
    if actuator.trntype == mujoco.mjtTrn.mjTRN_TENDON:
        path = spec.tendon(actuator.target).path
        return {wrap.target.name: float(wrap.coef) for wrap in path if wrap.type == mujoco.mjtWrap.mjWRAP_JOINT}
    return {actuator.target: 1.0}


MOTOR_SHARE = Parameter(
    "motor_share", "1", 0.02, 0.9, 0.5, 0.5, "part of armature and damping on the motor's side", log=True
)
DAMPING_SHARE = Parameter(
    "damping_share", "1", 0.0, 0.9, 0.0, 0.0, "part of the joint's other damping that is the motor's, too", refines=True
)


def motor_side(spec: Any, place: Place, values: Mapping[str, float]) -> Link:
    """Gives the actuator a motor of its own, once. The link is a bare tendon: the caller makes it hold.

    `motor_share` of the joint's armature becomes the motor's, with as much damping as makes neither side faster than
    the other, and `damping_share` of what damping the joint has beside that. The whole stays what it was.
    """
    name = link_tendon(place)
    if spec.tendon(name) is not None:
        return Link(name, made=False)
    actuator = spec.actuator(place.actuator)
    driven = pulled_joints(spec, actuator)
    before = spec.compile()
    own = {n: driven[n] for n in place.driven if n in driven}
    damping, braked, armature = _take_shares(spec, place, values, before, own)
    body = spec.worldbody.add_body(name=motor_joint(place))
    body.explicitinertial = True
    body.mass = _SMALLEST
    body.ipos = np.zeros(3)
    body.inertia = np.full(3, 1e-9)
    joint = body.add_joint(name=motor_joint(place), type=mujoco.mjtJoint.mjJNT_HINGE)
    joint.axis = np.array([0.0, 0.0, 1.0])
    joint.limited = mujoco.mjtLimited.mjLIMITED_FALSE
    joint.ref = sum(coefficient * spec.joint(n).ref for n, coefficient in driven.items())
    joint.damping = np.array([damping, 0.0, 0.0])
    joint.armature = armature
    joint.frictionloss = 0.0
    joint.stiffness = np.zeros(3)
    tendon = spec.add_tendon(name=name)
    tendon.wrap_joint(joint.name, 1.0)
    for n, coefficient in driven.items():
        tendon.wrap_joint(n, -coefficient)
    actuator.trntype = mujoco.mjtTrn.mjTRN_JOINT
    actuator.target = joint.name
    _brake(spec, motor_brake(place), joint.name, braked)
    keep_softness(spec, before, place.driven, () if place.tendon is None else (place.tendon,))
    return Link(name, made=True)


def motor_brake(place: Place) -> str:
    """The name of the constraint that brakes a motor of its own."""
    return f"{motor_joint(place)}_brake"


def _brake(spec: Any, name: str, joint: str, damping: float) -> None:
    """Damping of a motor as a constraint, N m s/rad.

    As the joint's own, MuJoCo adds it to the motor's inertia only after the force of the link has been found, which is
    then too small by as much: a light motor that is braked keeps its speed for milliseconds.
    """
    model = spec.compile()
    inverse_inertia = float(model.dof_invweight0[_dof(model, joint)])
    brake = spec.add_equality(name=name, type=mujoco.mjtEq.mjEQ_JOINT, name1=joint)
    brake.objtype = mujoco.mjtObj.mjOBJ_JOINT
    brake.active = damping > 0.0  # it is there anyway: models of one structure are rolled out together
    solref, solimp = implicit_step(float(spec.option.timestep), inverse_inertia, 0.0, max(damping, _HARDLY))
    brake.solref, brake.solimp = np.minimum(solref, -_NO_STIFFNESS), solimp


def _take_shares(
    spec: Any, place: Place, values: Mapping[str, float], model: Any, driven: dict[str, float]
) -> tuple[float, float, float]:
    """(damping as a joint has it, damping beside that, armature) for the motor, taken from the joints.

    Motor and joints together have what was.
    """
    part, beside = values[MOTOR_SHARE.name], values[DAMPING_SHARE.name]
    joints = [spec.joint(name) for name in driven]
    if len(joints) == 1:
        joint, size = joints[0], next(iter(driven.values()))
        armature = part * linear(joint, "armature")
        # as much damping by inertia on either side: neither is faster than the other in an implicit step
        damping = linear(joint, "damping") * armature / float(model.dof_M0[_dof(model, joint.name)])
        braked = beside * (linear(joint, "damping") - damping)
        _subtract(joint, "damping", damping + braked)
        _subtract(joint, "armature", armature)
        return damping / size**2, braked / size**2, max(armature / size**2, _SMALLEST)
    sizes = {abs(coefficient) for coefficient in driven.values()}
    weakest = {attribute: min(linear(joint, attribute) for joint in joints) for attribute in ("damping", "armature")}
    if len(joints) != 2 or len(sizes) != 1:  # no such balance is known here: a light motor comes on top
        return 0.05 * weakest["damping"], 0.0, max(0.05 * weakest["armature"], _SMALLEST)
    # diag(2, 2) = [1 1; 1 1] on the motor, which sees the sum, + [1 -1; -1 1] on the difference
    size = sizes.pop()
    difference = spec.add_tendon(name=f"{place.actuator}_difference")
    (first, one), (second, other) = driven.items()
    difference.wrap_joint(first, one / size)
    difference.wrap_joint(second, -other / size)
    damping, armature = 0.5 * part * weakest["damping"], 0.5 * part * weakest["armature"]
    braked = beside * (0.5 * weakest["damping"] - damping)
    for joint in joints:
        _subtract(joint, "damping", 2.0 * (damping + braked))
        _subtract(joint, "armature", 2.0 * armature)
    difference.damping[0], difference.armature = damping + braked, armature
    return damping / size**2, braked / size**2, max(armature / size**2, _SMALLEST)


def _subtract(joint: Any, attribute: str, share: float) -> None:
    current = getattr(joint, attribute)
    if np.ndim(current):
        current[0] -= share
    else:
        setattr(joint, attribute, current - share)


def implicit_spring(spec: Any, tendon: str, stiffness: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """(solref, solimp) that make a constraint on a tendon one implicit Euler step of a spring and damper.

    The step solves f = -(stiffness r + c v'), with c = damping + h stiffness and v' the speed after the step. In
    MuJoCo's terms: reference acceleration -(stiffness / (h c)) r - v / h, regularisation 1 / (h c). The impedance
    that gives this regularisation follows from the tendon's inverse inertia at rest, which the compiler knows.
    """
    model = spec.compile()
    inverse_inertia = float(model.tendon_invweight0[model.tendon(tendon).id])
    return implicit_step(float(spec.option.timestep), inverse_inertia, stiffness, damping)


def implicit_step(h: float, inverse_inertia: float, stiffness: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
    """The same for any constraint, from its inverse inertia at rest and the time step `h` in s."""
    c = damping + h * stiffness
    impedance = np.clip(1.0 / (1.0 + 1.0 / (h * c * inverse_inertia)), 1e-4, 0.9999)
    solref = -impedance * np.array([stiffness / (h * c), 1.0 / h])
    return solref, np.array([impedance, impedance, 0.001, 0.5, 2.0])


def implicit_law(solref: np.ndarray, solimp: np.ndarray, h: float, inverse_inertia: float) -> tuple[float, float]:
    """(stiffness, damping) that `implicit_step` has made these of."""
    impedance = float(solimp[0])
    c = impedance / ((1.0 - impedance) * h * inverse_inertia)
    stiffness = float(solref[0] / solref[1]) * c
    return stiffness, c - h * stiffness


def moved_out(width: float) -> float:
    """How far beyond each end of a gap its limit lies, which begins `OVERLAP` before: all of that where it is open.

    Both in rad or m. The ends of a closed gap, whose width is 0, overlap.
    """
    return _CLOSED - OVERLAP * float(np.expm1(-width / _OPENS))


def _dof(model: Any, joint: str) -> int:
    return int(model.jnt_dofadr[model.joint(joint).id])
