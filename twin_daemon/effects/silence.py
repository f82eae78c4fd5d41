"""A servo that does not see small errors: a joint beside its own that yields within a band."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Place, silent_joint
from twin_daemon.effects.edits import add_passive_motor, servo_damping, servo_stiffness
from twin_daemon.effects.transmission import OVERLAP, implicit_step, moved_out, pulled_joints
from twin_daemon.errors import BadInput

_STIFF = 1000.0  # the ends of the band over the servo
_LOSS_STEPS = 0.2  # damping over stiffness at these ends, in time steps: they are met without rebound
_LIGHT = 0.2  # inertia of what yields within the band, over what the servo moves in one time step
_NEVER = 1e3  # rad: an error that no servo has


def silent_within(spec: Any, place: Place, band: float) -> None:
    """Lets a servo act on `joint + s`, where `s` yields to it freely within a band (rad).

    `s` has hardly any inertia, and as much damping as brings it to the error within one time step. Raises BadInput
    where the servo already yields within a band.
    """
    if spec.joint(silent_joint(place)) is not None:
        raise BadInput(
            f"{place.target}: 'dead_zone' and 'backlash' with 'braked' are one law, so that there is no room for both",
            todo="Remove one, or set braked=0",
        )
    actuator, step = spec.actuator(place.actuator), float(spec.option.timestep)
    driven, gear = pulled_joints(spec, actuator), float(actuator.gear[0])
    stiffness = servo_stiffness(spec, place) * gear**2
    body = spec.worldbody.add_body(name=silent_joint(place))
    body.explicitinertial = True
    body.mass = 1e-6
    body.ipos = np.zeros(3)
    body.inertia = np.full(3, 1e-15)
    joint = body.add_joint(name=silent_joint(place), type=mujoco.mjtJoint.mjJNT_HINGE)
    joint.axis = np.array([0.0, 0.0, 1.0])
    # beside a derivative gain, which MuJoCo's step takes explicitly, less inertia would oscillate
    joint.armature = _LIGHT * step**2 * stiffness + step * servo_damping(spec, place) * gear**2
    joint.stiffness = joint.damping = np.zeros(3)
    # a friction that never gives way is a damper, and one within the solver: it knows of the ends
    joint.frictionloss = _NEVER * stiffness
    joint.solref_friction, joint.solimp_friction = implicit_step(step, 1.0 / joint.armature, 0.0, step * stiffness)
    ends = _STIFF * stiffness
    joint.solref_limit, joint.solimp_limit = implicit_step(step, 1.0 / joint.armature, ends, _LOSS_STEPS * step * ends)
    half = band + moved_out(band)
    joint.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    joint.range, joint.margin = np.array([-half, half]), OVERLAP
    tendon = spec.add_tendon(name=f"{place.actuator}_with_silence")
    for name, coefficient in driven.items():
        tendon.wrap_joint(name, coefficient)
    tendon.wrap_joint(joint.name, 1.0)
    actuator.trntype = mujoco.mjtTrn.mjTRN_TENDON
    actuator.target = tendon.name


def brakes_itself(spec: Any, place: Place) -> bool:
    """Whether a servo at a joint has a derivative gain."""
    actuator = spec.actuator(place.actuator)
    return actuator.trntype == mujoco.mjtTrn.mjTRN_JOINT and servo_damping(spec, place) > 0.0


def separate_derivative(spec: Any, place: Place) -> None:
    """Gives a servo's derivative gain to a motor of its own on the same joint, both within the servo's limits."""
    actuator = spec.actuator(place.actuator)
    brake = servo_damping(spec, place)
    other = add_passive_motor(spec, f"{place.actuator}_derivative", actuator.trntype, actuator.target)
    other.gear = actuator.gear
    other.gainprm[1] = np.sqrt(brake)  # a motor of resistance 1 that is shorted brakes by its constant squared
    actuator.biasprm[2] = 0.0
    model = spec.compile()
    index = model.actuator(place.actuator).id
    if model.actuator_forcelimited[index]:
        joint, gear = spec.joint(actuator.target), float(actuator.gear[0])
        low, high = sorted(gear * model.actuator_forcerange[index])
        if model.jnt_actfrclimited[model.joint(joint.name).id]:
            low, high = max(low, joint.actfrcrange[0]), min(high, joint.actfrcrange[1])
        joint.actfrclimited, joint.actfrcrange = mujoco.mjtLimited.mjLIMITED_TRUE, np.array([low, high])
        actuator.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
