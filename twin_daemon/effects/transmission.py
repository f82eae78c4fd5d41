"""A motor with a side of its own: a joint for the motor, and a link from it to what it drives.

The link is a constraint on a fixed tendon `motor - driven`, whose reference acceleration and softness are set so
that MuJoCo's solver computes one implicit Euler step of a spring and damper. Such a link has the stiffness it is
given, in N m/rad, and is stable at any stiffness and time step, which a spring of the same stiffness is not.

A share of the joint's armature and damping moves to the motor, so that the whole is what it was. Where the motor
drives the sum of two joints, their difference gets as much on a tendon of its own, for the same reason.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Parameter, Place, link_tendon, motor_joint
from twin_daemon.effects.edits import keep_softness, linear

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


def motor_side(spec: Any, place: Place, share: float) -> Link:
    """Gives the actuator a motor of its own, once. The link is a bare tendon: the caller makes it hold.

    `share` of the joint's armature and damping becomes the motor's; the whole stays what it was.
    """
    name = link_tendon(place)
    if spec.tendon(name) is not None:
        return Link(name, made=False)
    actuator = spec.actuator(place.actuator)
    driven = pulled_joints(spec, actuator)
    before = spec.compile()
    damping, armature = _take_share(spec, place, share, before, {n: driven[n] for n in place.driven if n in driven})
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
    keep_softness(spec, before, place.driven, () if place.tendon is None else (place.tendon,))
    return Link(name, made=True)


def _take_share(spec: Any, place: Place, part: float, model: Any, driven: dict[str, float]) -> tuple[float, float]:
    """(damping, armature) for the motor, taken from the joints so that motor and joints together have what was."""
    joints = [spec.joint(name) for name in driven]
    if len(joints) == 1:
        joint, size = joints[0], next(iter(driven.values()))
        armature = part * linear(joint, "armature")
        # as much damping by inertia on either side: neither is faster than the other in an implicit step
        damping = linear(joint, "damping") * armature / float(model.dof_M0[_dof(model, joint.name)])
        _subtract(joint, "damping", damping)
        _subtract(joint, "armature", armature)
        return damping / size**2, max(armature / size**2, _SMALLEST)
    sizes = {abs(coefficient) for coefficient in driven.values()}
    if len(joints) != 2 or len(sizes) != 1:  # no such balance is known here: a light motor comes on top
        weakest = min(linear(joint, "armature") for joint in joints)
        return 0.05 * min(linear(joint, "damping") for joint in joints), max(0.05 * weakest, _SMALLEST)
    # diag(2, 2) = [1 1; 1 1] on the motor, which sees the sum, + [1 -1; -1 1] on the difference
    size = sizes.pop()
    difference = spec.add_tendon(name=f"{place.actuator}_difference")
    (first, one), (second, other) = driven.items()
    difference.wrap_joint(first, one / size)
    difference.wrap_joint(second, -other / size)
    shares = []
    for attribute in ("damping", "armature"):
        share = 0.5 * part * min(linear(joint, attribute) for joint in joints)
        for joint in joints:
            _subtract(joint, attribute, 2.0 * share)
        shares.append(share)
    difference.damping[0], difference.armature = shares
    return shares[0] / size**2, max(shares[1] / size**2, _SMALLEST)


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


def moved_out(width: float) -> float:
    """How far beyond each end of a gap its limit lies, which begins `OVERLAP` before: all of that where it is open.

    Both in rad or m. The ends of a closed gap, whose width is 0, overlap.
    """
    return _CLOSED - OVERLAP * float(np.expm1(-width / _OPENS))


def _dof(model: Any, joint: str) -> int:
    return int(model.jnt_dofadr[model.joint(joint).id])
