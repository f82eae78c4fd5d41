"""The physical parameters that a MuJoCo model already has, by kind.

A parameter is named `<joint or command as in the data>.<kind>`, or `<body>.<kind>` for inertial ones. Each
kind writes the same change in two places: into a compiled model (fast, no recompiling: for fits) and into the
MjSpec (for the MJCF that is stored). A test holds both writes to the same compiled model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np

from twin_daemon.effects.edits import impedance_of, softness

Element = Literal["joint", "actuator", "tendon", "body"]
_FAR = 10.0  # times what a model says of a positive number: further from it no fit of that model is believed


@dataclass(frozen=True)
class ParameterKind:
    """One kind of parameter: its unit, physical bounds, and how it is read and written.

    `lower` and `upper` are what is physically sensible for the parts of a hand or a small arm, not a search
    box; `limits` are wider where the model itself is of another size. `log` says that the parameter is positive and is
    searched by its logarithm. `constants` says that MuJoCo derives constants from it, so that mj_setConst has to follow
    a write into a compiled model.
    """

    key: str
    element: Element
    unit: str
    lower: float
    upper: float
    log: bool
    read: Callable[[mujoco.MjModel, int], float]
    write: Callable[[mujoco.MjModel, int, float], None]
    edit: Callable[[Any, float], None]
    constants: bool = False

    def limits(self, own: float) -> tuple[float, float]:
        """What is accepted where the model itself has the value `own`, in its unit: its maker knows its size."""
        if self.log:
            return (min(self.lower, own / _FAR) if own > 0.0 else self.lower), max(self.upper, own * _FAR)
        if self.lower <= own <= self.upper:
            return self.lower, self.upper
        far = 2.0 * abs(own)
        return min(self.lower, -far), max(self.upper, far)

    def __reduce__(self) -> tuple[Callable[[str], ParameterKind], tuple[str]]:
        return _by_key, (self.key,)  # a kind is its key, in another process, too


def _by_key(key: str) -> ParameterKind:
    return KINDS[key]


def _dof(model: mujoco.MjModel, joint: int) -> int:
    return int(model.jnt_dofadr[joint])


def _dof_kind(key: str, field: str, unit: str, lower: float, upper: float, *, constants: bool = False):
    def read(model: mujoco.MjModel, joint: int) -> float:
        return float(getattr(model, field)[_dof(model, joint)])

    def write(model: mujoco.MjModel, joint: int, value: float) -> None:
        getattr(model, field)[_dof(model, joint)] = value

    def edit(joint: Any, value: float) -> None:
        _set_first(joint, key, value)

    return ParameterKind(key, "joint", unit, lower, upper, True, read, write, edit, constants)


def _set_first(element: Any, attribute: str, value: float) -> None:
    """Sets an attribute that is a number, or the linear coefficient of one that is a polynomial."""
    current = getattr(element, attribute)
    if np.ndim(current):
        current[0] = value
    else:
        setattr(element, attribute, value)


def _edit_softness(joint: Any, value: float) -> None:
    joint.solimp_friction[0] = impedance_of(value)


def _write_springref(model: mujoco.MjModel, joint: int, value: float) -> None:
    model.qpos_spring[model.jnt_qposadr[joint]] = value


_SLACK = 1e-5  # N m/rad: the weakest spring that can still hold a preload


def _write_preload(model: mujoco.MjModel, joint: int, value: float) -> None:
    model.jnt_stiffness[joint] = max(model.jnt_stiffness[joint], _SLACK)
    _write_springref(model, joint, value / model.jnt_stiffness[joint])


def _edit_preload(joint: Any, value: float) -> None:
    stiffness = float(np.ravel(joint.stiffness)[0])
    if stiffness < _SLACK:
        stiffness = _SLACK
        _set_first(joint, "stiffness", stiffness)
    joint.springref = value / stiffness


def _range_kind(key: str, side: int) -> ParameterKind:
    def write(model: mujoco.MjModel, joint: int, value: float) -> None:
        model.jnt_range[joint, side] = value

    def edit(joint: Any, value: float) -> None:
        joint.range[side] = value

    return ParameterKind(
        key, "joint", "rad", -np.pi, np.pi, False, lambda m, j: float(m.jnt_range[j, side]), write, edit
    )


def _write_kp(model: mujoco.MjModel, actuator: int, value: float) -> None:
    model.actuator_gainprm[actuator, 0] = value
    model.actuator_biasprm[actuator, 1] = -value


def _edit_kp(actuator: Any, value: float) -> None:
    if actuator.biasprm[2] > 0.0:  # a damping ratio, which is of the gain: the derivative gain stays, as in a model
        actuator.biasprm[2] *= np.sqrt(actuator.gainprm[0] / value)
    actuator.gainprm[0] = value
    actuator.biasprm[1] = -value


def _tendon_kind(key: str, field: str, attribute: str, unit: str, upper: float) -> ParameterKind:
    def write(model: mujoco.MjModel, tendon: int, value: float) -> None:
        getattr(model, field)[tendon] = value

    def edit(tendon: Any, value: float) -> None:
        _set_first(tendon, attribute, value)

    return ParameterKind(key, "tendon", unit, 1e-5, upper, True, lambda m, t: float(getattr(m, field)[t]), write, edit)


def _scale_mass(model: mujoco.MjModel, body: int, value: float) -> None:
    # mass and inertia together: a denser body, which always exists
    factor = value / model.body_mass[body]
    model.body_mass[body] = value
    model.body_inertia[body] *= factor


def _edit_mass(body: Any, value: float) -> None:
    factor = value / body.mass
    body.mass = value
    body.inertia = np.asarray(body.inertia) * factor


def _com_kind(axis: int) -> ParameterKind:
    def write(model: mujoco.MjModel, body: int, value: float) -> None:
        model.body_ipos[body, axis] = value

    def edit(body: Any, value: float) -> None:
        body.ipos[axis] = value

    return ParameterKind(
        f"com_{'xyz'[axis]}", "body", "m", -0.5, 0.5, False, lambda m, b: float(m.body_ipos[b, axis]), write, edit, True
    )


def _read_inertia(model: mujoco.MjModel, body: int) -> float:
    return float(model.body_inertia[body].sum())


def _scale_inertia(model: mujoco.MjModel, body: int, value: float) -> None:
    # all three moments by one factor: the triangle inequality of a real body stays satisfied
    model.body_inertia[body] *= value / model.body_inertia[body].sum()


def _edit_inertia(body: Any, value: float) -> None:
    inertia = np.asarray(body.inertia)
    body.inertia = inertia * (value / inertia.sum())


KINDS: dict[str, ParameterKind] = {
    kind.key: kind
    for kind in (
        _dof_kind("damping", "dof_damping", "N m s/rad", 1e-6, 1e4),
        _dof_kind("frictionloss", "dof_frictionloss", "N m", 1e-7, 1e4),
        _dof_kind("armature", "dof_armature", "kg m2", 1e-9, 1e3, constants=True),
        ParameterKind(
            "friction_softness",
            "joint",
            "1",
            1e-4,
            100.0,
            True,
            lambda m, j: softness(float(m.dof_solimp[_dof(m, j), 0])),
            lambda m, j, v: m.dof_solimp.__setitem__((_dof(m, j), 0), impedance_of(v)),
            _edit_softness,
        ),
        ParameterKind(
            "stiffness",
            "joint",
            "N m/rad",
            1e-5,
            50.0,
            True,
            lambda m, j: float(m.jnt_stiffness[j]),
            lambda m, j, v: m.jnt_stiffness.__setitem__(j, v),
            lambda joint, v: _set_first(joint, "stiffness", v),
        ),
        ParameterKind(
            "springref",
            "joint",
            "rad",
            -200.0,
            200.0,
            False,
            lambda m, j: float(m.qpos_spring[m.jnt_qposadr[j]]),
            _write_springref,
            lambda joint, v: setattr(joint, "springref", v),
        ),
        ParameterKind(
            "preload",
            "joint",
            "N m",
            -5.0,
            5.0,
            False,
            lambda m, j: float(m.jnt_stiffness[j] * m.qpos_spring[m.jnt_qposadr[j]]),
            _write_preload,
            _edit_preload,
        ),
        _range_kind("range_lower", 0),
        _range_kind("range_upper", 1),
        ParameterKind(
            "kp",
            "actuator",
            "N m/rad",
            1e-4,
            1e7,
            True,
            lambda m, a: float(m.actuator_gainprm[a, 0]),
            _write_kp,
            _edit_kp,
        ),
        _tendon_kind("tendon_damping", "tendon_damping", "damping", "N m s/rad", 20.0),
        _tendon_kind("tendon_frictionloss", "tendon_frictionloss", "frictionloss", "N m", 5.0),
        ParameterKind(
            "mass",
            "body",
            "kg",
            1e-4,
            50.0,
            True,
            lambda m, b: float(m.body_mass[b]),
            _scale_mass,
            _edit_mass,
            True,
        ),
        ParameterKind("inertia", "body", "kg m2", 1e-9, 10.0, True, _read_inertia, _scale_inertia, _edit_inertia, True),
        _com_kind(0),
        _com_kind(1),
        _com_kind(2),
    )
}
"""Every kind of parameter by its key.

`preload` is the spring's torque at angle 0; `inertia` is the sum of the three principal moments. `friction_softness` is
(1 - d) / d of the impedance d with which MuJoCo solves for dry friction: a joint that friction holds under a load
creeps in proportion (MuJoCo's documentation, Computation, Friction loss). Where a model says nothing it is 0.11, which
gives way within a second; real dry friction stays.
"""
