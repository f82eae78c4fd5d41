"""Every kind of parameter: two ways to write it, one compiled model, and nothing unphysical."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.simulation.parameters import KINDS, ParameterKind
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

FIELDS = (
    "dof_damping", "dof_frictionloss", "dof_solimp", "dof_armature", "dof_M0", "dof_invweight0", "jnt_stiffness",
    "jnt_range", "qpos_spring", "actuator_gainprm", "actuator_biasprm", "tendon_damping", "tendon_frictionloss",
    "body_mass", "body_inertia", "body_ipos", "body_iquat", "body_subtreemass", "body_invweight0",
)  # fmt: skip


def place(kind: ParameterKind, twin: TwinModel) -> str:
    if kind.element == "body":
        return twin.model.body(int(twin.model.joint("rh_FFJ3").bodyid[0])).name
    return "rh_FFJ0" if kind.element in ("tendon", "actuator") else "rh_FFJ2"


def other_value(kind: ParameterKind, current: float) -> float:
    if kind.log:
        return float(np.clip(1.7 * current or 50 * kind.lower, kind.lower, kind.upper))
    return current + 0.03


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_write_into_the_compiled_model_is_an_edit_of_the_mjcf(kind: ParameterKind, twin: TwinModel) -> None:
    name = f"{place(kind, twin)}.{kind.key}"
    ref = twin.parameter(name)
    value = other_value(kind, ref.read(twin.model))
    written = copy.copy(twin.model)
    ref.write(written, value)
    mujoco.mj_setConst(written, mujoco.MjData(written))
    edited = twin.changed(Terms(parameters={name: value}))
    assert ref.read(written) == pytest.approx(value)
    assert edited.parameter(name).read(edited.model) == pytest.approx(value)
    for field in FIELDS:
        one, other = getattr(written, field), getattr(edited.model, field)
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-12, err_msg=field)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_a_stored_mjcf_has_the_value(kind: ParameterKind, twin: TwinModel) -> None:
    name = f"{place(kind, twin)}.{kind.key}"
    value = other_value(kind, twin.parameter(name).read(twin.model))
    stored = TwinModel.from_mjcf(twin.hand, twin.changed(Terms(parameters={name: value})).mjcf())
    assert stored.parameter(name).read(stored.model) == pytest.approx(value, rel=1e-5)


@pytest.mark.parametrize(
    ("name", "value"),
    [("rh_FFJ3.damping", -0.1), ("rh_FFJ3.frictionloss", -1e-3), ("rh_FFJ0.kp", 0.0), ("rh_FFJ0.kp", float("nan"))],
)
def test_what_cannot_be_is_refused(name: str, value: float, twin: TwinModel) -> None:
    with pytest.raises(BadInput, match=r"not physical.*Allowed"):
        twin.changed(Terms(parameters={name: value}))


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("rh_FFJ3.dampin", "Did you mean 'damping'"),
        ("rh_THJ55.damping", "Did you mean 'rh_THJ5'"),
        ("rh_FFJ0.damping", "has no joint"),
        ("rh_FFJ3.tendon_damping", "has no tendon"),
        ("nowhere.mass", "no body"),
    ],
)
def test_what_is_not_there_is_named_with_its_neighbours(name: str, says: str, twin: TwinModel) -> None:
    with pytest.raises(BadInput, match=says):
        twin.parameter(name)


def test_a_heavier_body_keeps_an_inertia_that_exists(twin: TwinModel) -> None:
    name = place(KINDS["mass"], twin)
    heavy = twin.changed(Terms(parameters={f"{name}.mass": 0.5, f"{name}.inertia": 1e-3}))
    a, b, c = sorted(heavy.model.body(name).inertia)
    assert a > 0
    assert a + b >= c
    assert heavy.model.body(name).mass[0] == pytest.approx(0.5)
    assert a + b + c == pytest.approx(1e-3)
