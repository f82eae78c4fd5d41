"""Edits of an MjSpec that several effects share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Place
from twin_daemon.errors import BadInput

_NO_INPUT = 16  # the signature of `input="none"`
_STABLE, _BRISTLE = 0.8, 0.13  # of a joint's inertia over the square of a step
_LEAST_OF_LINKS = 0.5  # of the links' inertia is left in other poses


def linear(element: Any, attribute: str) -> float:
    """A coefficient of an element, or the linear one where MuJoCo has a polynomial."""
    return float(np.ravel(getattr(element, attribute))[0])


def add_to_linear(element: Any, attribute: str, amount: float, place: Place) -> None:
    """Adds to a coefficient that physics keeps at 0 or above. Raises BadInput below it."""
    total = linear(element, attribute) + amount
    if total < 0.0:
        raise BadInput(
            f"{place.target}: {attribute} would be {total:g}, and negative {attribute} feeds energy in",
            allowed=f"at least {-linear(element, attribute):g} beside the model's own",
        )
    current = getattr(element, attribute)
    if np.ndim(current):
        current[0] = total
    else:
        setattr(element, attribute, total)


def add_joint_tendon(
    spec: Any, name: str, joints: Mapping[Any, float], *, stiffness: float = 0.0, rest: tuple[float, float]
) -> Any:
    """A fixed tendon over joints {name: coefficient} with a spring that pulls outside the lengths `rest`, in rad."""
    tendon = spec.add_tendon(name=name)
    for joint, coefficient in joints.items():
        tendon.wrap_joint(joint, coefficient)
    tendon.stiffness[0] = stiffness
    # a length of -1 alone would mean "take it from the model" to MuJoCo
    tendon.springlength = np.array([length + 1e-9 * (length == -1.0) for length in rest])
    return tendon


def require_free_dynamics(actuator: Any, place: Place, effect: str) -> None:
    """Raises BadInput where the actuator already has a filter: MuJoCo gives an actuator one kind of dynamics."""
    if actuator.dyntype != mujoco.mjtDyn.mjDYN_NONE:
        raise BadInput(
            f"{place.target}: '{effect}' has no room, since the actuator already filters its command",
            allowed="one of actuator_lag and rate_limit at an actuator",
            todo="Remove the other one",
        )


def servo_stiffness(spec: Any, place: Place) -> float:
    """Gain of the servo at this place in N m/rad; 1 where nothing drives it."""
    if place.actuator is None:
        return 1.0
    return abs(float(spec.actuator(place.actuator).biasprm[1])) or 1.0


def servo_damping(spec: Any, place: Place) -> float:
    """Derivative gain of the servo at this place in N m s/rad."""
    own = float(spec.actuator(place.actuator).biasprm[2])
    # until it is compiled, a positive value is a damping ratio
    return -own if own <= 0.0 else -float(spec.compile().actuator(place.actuator).biasprm[2])


def add_passive_motor(spec: Any, name: str, kind: Any, target: str | None) -> Any:
    """A `dcmotor` without inputs and without an electrical side: it only carries LuGre friction or cogging."""
    motor = spec.add_actuator(name=name, trntype=kind, target=target)
    motor.dyntype = mujoco.mjtDyn.mjDYN_DCMOTOR
    motor.gaintype = mujoco.mjtGain.mjGAIN_DCMOTOR
    motor.biastype = mujoco.mjtBias.mjBIAS_DCMOTOR
    motor.ctrlspec = _NO_INPUT
    motor.gainprm = np.array([1.0, *np.zeros(9)])  # resistance 1, motor constant 0
    motor.dynprm = np.zeros(10)
    motor.biasprm = np.zeros(10)
    motor.actdim = 0
    motor.actearly = True
    return motor


def stable_stiffness(spec: Any, place: Place) -> float:
    """The stiffest spring in N m/rad at a joint that an explicit step bears with a margin."""
    return _STABLE * _least_inertia(spec, place) / float(spec.option.timestep) ** 2


def bristle_stiffness(spec: Any, place: Place) -> float:
    """What the bristles of dry friction have at a joint, N m/rad.

    They give way by friction over stiffness, which shrinks with the square of the step, so that it is an error of the
    step and most of it is taken out with that. MuJoCo pulls by where they were at the step's beginning: stiffer than
    the joint's damping over the step they ring, the more the stiffer. What stick-slip leaves of development cases
    hardly changes from a fifth of this to six times as much.
    """
    return _BRISTLE * _least_inertia(spec, place) / float(spec.option.timestep) ** 2


def _least_inertia(spec: Any, place: Place) -> float:
    """kg m^2 that a joint has in any pose while all others are free, with what its damping counts for in a step."""
    joint = spec.joint(place.joint)
    inertia = float(joint.armature) + _LEAST_OF_LINKS * place.inertia
    implicit = spec.option.integrator != mujoco.mjtIntegrator.mjINT_RK4
    return inertia + (0.5 * float(spec.option.timestep) * linear(joint, "damping") if implicit else 0.0)


def keep_softness(spec: Any, before: mujoco.MjModel, joints: Iterable[str], tendons: Iterable[str]) -> None:
    """Leaves the friction and the limits of joints and tendons as soft as they were in the model `before`.

    MuJoCo scales softness by the inertia at rest, which an edit of what a joint carries has changed. Friction creeps
    and a limit gives way by it.
    """
    after = spec.compile()
    for name in joints:
        weights = [float(m.dof_invweight0[m.jnt_dofadr[m.joint(name).id]]) for m in (after, before)]
        joint = spec.joint(name)
        joint.solimp_friction[0] = _stiffer(joint.solimp_friction[0], *weights)
        joint.solimp_limit[:2] = [_stiffer(value, *weights) for value in joint.solimp_limit[:2]]
    for name in tendons:
        weights = [float(m.tendon_invweight0[m.tendon(name).id]) for m in (after, before)]
        tendon = spec.tendon(name)
        tendon.solimp_friction[0] = _stiffer(tendon.solimp_friction[0], *weights)


def _stiffer(impedance: float, after: float, before: float) -> float:
    """The impedance d for which (1 - d) / d is smaller by as much as an inverse inertia has grown."""
    return float(impedance_of(softness(impedance) * before / after))


def softness(impedance: float) -> float:
    """(1 - d) / d of an impedance d, to which MuJoCo makes what a constraint gives way by proportional."""
    return (1.0 - impedance) / impedance


def impedance_of(softness: float) -> float:
    """The impedance that is as soft."""
    return 1.0 / (1.0 + softness)
