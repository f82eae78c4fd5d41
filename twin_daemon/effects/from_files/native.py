"""How a law that was found becomes elements of an MJCF, and what that costs where MuJoCo has no element for it.

A torque over the angle is a tendon's spring where its formula is a line or a stop, otherwise a sum of sines, each a
`dcmotor` without input whose cogging it is, as for `torque_ripple`. A torque over the speed is a damping polynomial
with dry friction, one over the acceleration is armature. Play is Dahl friction, one element a width. A change of the
reading is no mechanics at all and stands in the measurement model.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Place
from twin_daemon.effects.edits import add_joint_tendon, add_passive_motor, add_to_linear, linear, stable_stiffness
from twin_daemon.effects.from_files.schema import EffectFile

_NATIVE = ("position", "velocity", "acceleration")
_SINES = 16
_LEAST_SINE = 1e-3  # of the largest
_FLOOR_NM = 1e-9
_FAR_RAD = 1e3  # beyond any angle


def cost(effect: EffectFile) -> str:
    """What the native form leaves out, in a sentence; empty where it leaves nothing out."""
    if effect.port == "reading":
        return "" if exists(effect) else "readings of a twin do not depend on the time"
    own = (effect.port, effect.over, effect.factor, effect.memory)
    if own == ("torque", "position", "", ""):
        return "" if sine_of(effect) or spring_of(effect) else (
            f"the MJCF has {_SINES} sines of the angle: the curve within a few percent where it was visited, and its "
            "mirror image beyond"
        )  # fmt: skip
    if own == ("torque", "acceleration", "", ""):
        return "" if "slope" in effect.formula_values else "the MJCF has armature: the mean slope of the curve"
    if own[:2] == ("torque", "velocity") and not effect.memory:
        return "the MJCF has damping that grows with speed and dry friction: what differs between directions is lost"
    if effect.memory == "play":
        return "the MJCF has Dahl friction, whose corners are round; elements that push are lost"
    if effect.port == "command" and exists(effect):
        return "the MJCF has the mean gain of the servo only: MuJoCo has no element for the rest"
    return "MuJoCo has no element for such a law, and nothing that comes near it"


def exists(effect: EffectFile) -> bool:
    """Whether a model can have anything of the law at all."""
    if effect.port == "reading":
        return effect.over != "time"
    if effect.port == "torque":
        if effect.memory or effect.factor:
            return effect.memory == "play" or effect.over == "velocity"
        return effect.over in _NATIVE
    return not effect.memory and (effect.factor == "error" or effect.over == "error")


def sine_of(effect: EffectFile) -> tuple[float, float, float] | None:
    """(amplitude, waves a radian, phase) where the formula of the law is one sine of the angle."""
    values = effect.formula_values
    if effect.over != "position" or not {"amplitude", "waves", "phase"} <= values.keys():
        return None
    return values["amplitude"][0], values["waves"][0], values["phase"][0]


def spring_of(effect: EffectFile) -> tuple[float, float, tuple[float, float]] | None:
    """(N m, N m/rad, two angles) where the formula is a constant and a spring that pulls outside of the two angles.

    A straight line that pushes is none, since MuJoCo has no negative stiffness.
    """
    values = {name: found[0] for name, found in effect.formula_values.items()}
    if effect.over != "position" or values.keys() - {"constant", "slope", "stiffness", "lower", "upper"}:
        return None
    constant, stiffness = values.get("constant", 0.0), values.get("stiffness", -values.get("slope", 0.0))
    if stiffness < 0.0 or not values:
        return None
    if "stiffness" not in values:
        return constant, stiffness, (0.0, 0.0)
    return constant, stiffness, (values.get("lower", -_FAR_RAD), values.get("upper", _FAR_RAD))


def write(spec: Any, place: Place, effect: EffectFile, strength: float) -> None:
    """Writes the law into a model, `strength` times as strong as it was found."""
    own = (effect.port, effect.over, effect.factor, effect.memory)
    spring = spring_of(effect)
    if own == ("torque", "position", "", "") and spring and strength >= 0.0:
        _spring(spec, place, effect, strength, *spring)
    elif own == ("torque", "position", "", ""):
        _sines(spec, place, effect, strength)
    elif own == ("torque", "acceleration", "", ""):
        _armature(spec, place, effect, strength)
    elif own[:2] == ("torque", "velocity") and not effect.memory:
        _damping(spec, place, effect, strength)
    elif effect.port == "torque" and effect.memory == "play":
        _dahl(spec, place, effect, strength)
    elif effect.port == "command":
        _mean_gain(spec, place, effect, strength)


def _spring(
    spec: Any, place: Place, effect: EffectFile, strength: float, constant: float, stiffness: float,
    rest: tuple[float, float],
) -> None:  # fmt: skip
    name = f"{place.joint}_{effect.name}"
    if stiffness:
        add_joint_tendon(spec, f"{name}_spring", {place.joint: 1.0}, stiffness=strength * stiffness, rest=rest)
    if constant:
        motor = add_passive_motor(spec, name, mujoco.mjtTrn.mjTRN_JOINT, place.joint)
        motor.biasprm = np.array([strength * constant, 1e-9, 0.5 * np.pi, *np.zeros(7)])


def _sines(spec: Any, place: Place, effect: EffectFile, strength: float) -> None:
    for number, (amplitude, waves, phase) in enumerate(_series(effect)):
        name = f"{place.joint}_{effect.name}_{number}"
        motor = add_passive_motor(spec, name, mujoco.mjtTrn.mjTRN_JOINT, place.joint)
        motor.biasprm = np.array([strength * amplitude, waves, phase, *np.zeros(7)])


def _series(effect: EffectFile) -> list[tuple[float, float, float]]:
    """(amplitude, waves a radian, phase) of each sine: of the formula, or of the curve mirrored at its ends."""
    sine = sine_of(effect)
    if sine is not None:
        constant = effect.formula_values.get("constant", (0.0,))[0]
        return [sine, (constant, 1e-9, 0.5 * np.pi)] if constant else [sine]
    low, high = effect.knots[0], effect.knots[-1]
    at = np.linspace(low, high, 401)
    curve = np.interp(at, effect.knots, effect.values)
    waves = np.arange(_SINES) * np.pi / (high - low)
    basis = np.cos(waves * (at - low)[:, None])
    sizes, *_ = np.linalg.lstsq(basis, curve, rcond=None)
    least = _LEAST_SINE * np.abs(sizes).max(initial=0.0)
    return [
        (float(size), max(float(wave), 1e-9), float(0.5 * np.pi - wave * low))
        for size, wave in zip(sizes, waves, strict=True)
        if abs(size) > least
    ]


def _damping(spec: Any, place: Place, effect: EffectFile, strength: float) -> None:
    at, against = np.array(effect.knots), -np.array(effect.values)
    if effect.factor == "direction":  # levels of friction, against the motion either way
        against = -against * np.sign(at)
    basis = np.stack([at, at * np.abs(at), at**3, np.sign(at)], axis=1)
    far = max(float(np.abs(at).max()), 1e-9)
    scales = np.array([far, far**2, far**3, 1.0])
    found = strength * np.linalg.lstsq(basis / scales, against, rcond=None)[0] / scales
    joint = spec.joint(place.joint)
    joint.damping = np.array(joint.damping) + np.array([max(found[0], -linear(joint, "damping")), *found[1:3]])
    add_to_linear(joint, "frictionloss", max(float(found[3]), -linear(joint, "frictionloss")), place)


def _armature(spec: Any, place: Place, effect: EffectFile, strength: float) -> None:
    """A torque against the acceleration is inertia; the joint keeps a hundredth of its own at least."""
    at, values = np.array(effect.knots), np.array(effect.values)
    slope = float(np.polyfit(at, values, 1)[0])
    joint = spec.joint(place.joint)
    joint.armature = max(joint.armature - strength * slope, 0.01 * joint.armature)


def _dahl(spec: Any, place: Place, effect: EffectFile, strength: float) -> None:
    for number, (width, torque) in enumerate(zip(effect.knots, effect.values, strict=True)):
        gives = max(strength * torque, 0.0) + _FLOOR_NM
        motor = add_passive_motor(spec, f"{place.joint}_{effect.name}_{number}", mujoco.mjtTrn.mjTRN_JOINT, place.joint)
        motor.biasprm = np.array([0, 0, 0, gives, gives, 1.0, 0, 0, 0, 0])
        motor.dynprm = np.array(
            [0, 0, 0, 0, 0, min(max(gives / width, 1e-6), stable_stiffness(spec, place)), 0, 0, 0, 0]
        )
        motor.actdim = 1


def _mean_gain(spec: Any, place: Place, effect: EffectFile, strength: float) -> None:
    """The slope of the law over the servo's error, in the mean over what was visited."""
    at, values = np.array(effect.knots), np.array(effect.values)
    if effect.factor == "error":
        slope = float(np.trapezoid(values, at) / (at[-1] - at[0]))
    else:
        slope = float(at @ values / max(float(at @ at), 1e-12))
    actuator = spec.actuator(place.actuator)
    factor = max(1.0 + strength * slope, 0.05)
    actuator.gainprm[0] *= factor
    actuator.biasprm[1] *= factor
