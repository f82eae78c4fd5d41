"""Spaces as data: those that come with the program, and a user's own."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml

from twin_daemon.calibration.spaces import load_space, objective_of, space_names, variables_of
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.estimation.problem import Problem
from twin_daemon.simulation.parameters import KINDS
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

CONTRACT = {"physical", "first-approach", "second-approach", "thumb", "inertial"}
MOVING = tuple(f"rh_{f}J{n}" for f in ("FF", "LF", "MF", "RF", "TH") for n in (1, 2, 3))


@pytest.fixture(params=sorted(CONTRACT))
def space_name(request: pytest.FixtureRequest) -> str:
    return request.param


def test_the_spaces_of_the_contract_are_there() -> None:
    assert set(space_names()) >= CONTRACT


def test_every_space_stays_physical_over_all_of_its_box(space_name: str, twin: TwinModel) -> None:
    space = load_space(space_name)
    variables = variables_of(space, twin, MOVING)
    assert objective_of(space, twin, MOVING)
    for variable in variables:
        kind = KINDS[variable.name.rpartition(".")[2]]
        assert kind.lower <= variable.lower < variable.upper <= kind.upper
        assert variable.lower <= variable.start <= variable.upper
        assert variable.joints


def test_the_second_approach_is_the_dissertations(twin: TwinModel) -> None:
    variables = {k.name: k for k in variables_of(load_space("second-approach"), twin, MOVING)}
    assert len(variables) == 15
    assert variables["FJ1.damping"].lower == pytest.approx(0.05 * 0.3)
    assert variables["FJ1.damping"].upper == pytest.approx(0.05 * 1.7)
    assert len(variables["FJ1.damping"].parameters_moved) == 4


def test_every_body_of_the_inertial_space_exists(twin: TwinModel, rng: np.random.Generator) -> None:
    variables = variables_of(load_space("inertial"), twin, ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3"))
    problem = Problem(twin, [], variables, ["rh_FFJ3"])
    for point in rng.random((20, len(variables))):
        model = problem.candidate(point).model
        assert (model.body_mass[1:] > 0).all()
        moments = np.sort(model.body_inertia[1:], axis=1)
        assert (moments[:, 0] > 0).all()
        assert (moments[:, 0] + moments[:, 1] >= moments[:, 2] * (1 - 1e-9)).all()
        mass = np.zeros((model.nv, model.nv))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        assert np.linalg.eigvalsh(mass).min() > 0


def test_only_stops_that_exist_can_move(twin: TwinModel) -> None:
    variables = variables_of(load_space("physical"), twin, ("rh_FFJ3",))
    assert {k.name for k in variables} >= {"rh_FFJ3.range_upper", "rh_FFJ3.kp", "rh_FFJ3.preload"}
    assert not [k for k in variables if k.name.startswith("rh_FFJ0")]


GOOD = {"schema": 1, "name": "mine", "about": "mine", "parameters": [{"kind": "damping", "of": ["moving"]}]}


def own(tmp_path: Path, **changes: object) -> str:
    path = tmp_path / "space.yaml"
    path.write_text(yaml.safe_dump({**GOOD, **changes}))
    return str(path)


def test_a_space_of_ones_own(tmp_path: Path, twin: TwinModel) -> None:
    variables = variables_of(load_space(own(tmp_path)), twin, ("rh_FFJ3",))
    assert [k.name for k in variables] == ["rh_FFJ3.damping"]


def test_values_of_effects_are_fitted_where_they_are(tmp_path: Path, twin: TwinModel) -> None:
    space = load_space(own(tmp_path, parameters=[{"kind": "effects", "of": ["moving"]}]))
    there = EffectTerm(effect="backlash", target="rh_FFJ3", values={"gap": 0.03, "motor_share": 0.2})
    changed = twin.changed(twin.terms.with_effect(there))
    variables = {k.name: k for k in variables_of(space, changed, ("rh_FFJ3",))}
    assert variables["backlash:rh_FFJ3.gap"].start == pytest.approx(0.03)
    with pytest.raises(BadInput, match="moves nothing"):
        variables_of(space, changed, ("rh_MFJ3",))


def test_an_effect_of_one_value_can_be_turned_without_having_been_added(tmp_path: Path, twin: TwinModel) -> None:
    entry = {"kind": "sensor_offset.offset", "of": ["moving"], "reach": 0.03}
    (variable,) = variables_of(load_space(own(tmp_path, parameters=[entry])), twin, ("rh_FFJ3",))
    assert (variable.lower, variable.start, variable.upper) == (-0.03, 0.0, 0.03)
    candidate = Problem(twin, [], (variable,), ["rh_FFJ3"]).candidate(np.array([1.0]))
    assert candidate.measurement.offset_rad["rh_FFJ3"] == pytest.approx(0.03)


def test_what_a_gain_was_fitted_to_moves_no_range_of_an_effect(twin: TwinModel) -> None:
    """A closing hardly shows the gain of a finger's tendon, so that a fit may end at fifty times it."""
    term = EffectTerm(effect="coupling", target="rh_FFJ0", values={"friction_tendon": 3.0})  # above its range
    split = twin.changed(twin.terms.with_effect(term))
    stiff = split.changed(split.terms.with_parameters({"rh_FFJ0.kp": 500.0}))
    space = load_space("with-effects")
    ranges = [
        {v.name: (v.lower, v.upper, v.start) for v in variables_of(space, one, MOVING) if v.name.startswith("coupling")}
        for one in (split, stiff)
    ]
    assert ranges[0] == ranges[1]
    assert ranges[0]["coupling:rh_FFJ0.preload"][:2] == (-2.0, 2.0)
    assert ranges[0]["coupling:rh_FFJ0.friction_tendon"] == (0.0, 3.0, 3.0)


def test_a_parameter_starts_where_the_model_has_it_before_its_effects(twin: TwinModel) -> None:
    # the coupling moves the range of the distal joint away to put a limit of its own in its place
    there = EffectTerm(effect="coupling", target="rh_FFJ0", values=LIBRARY["coupling"].complete({}))
    changed = twin.changed(twin.terms.with_effect(there))
    variables = {k.name: k for k in variables_of(load_space("with-effects"), changed, ("rh_FFJ1", "rh_FFJ2"))}
    lower = twin.parameter("rh_FFJ1.range_lower").read(twin.model)
    assert variables["rh_FFJ1.range_lower"].start == pytest.approx(lower)


@pytest.mark.parametrize(
    ("entry", "says"),
    [
        ({"kind": "backlsh.gap", "of": ["moving"]}, "Did you mean 'backlash'"),
        ({"kind": "sensor_offset.offst", "of": ["moving"]}, "Did you mean 'offset'"),
        ({"kind": "backlash.gap", "of": ["driving"]}, "4 parameters.*effects"),
        ({"kind": "dampin", "of": ["moving"]}, "Did you mean 'damping'"),
        ({"kind": "damping", "of": ["rh_XXJ3"]}, "no joint or command 'rh_XXJ3'"),
        ({"kind": "damping", "of": ["moving"], "lower": -1.0}, "not physical.*Allowed"),
        ({"kind": "damping", "of": ["moving"], "lower": 2.0, "upper": 1.0}, "not physical"),
        ({"kind": "springref", "of": ["moving"], "within": 0.5, "start": 0.0}, "starts at 0.*reach"),
        ({"kind": "tendon_damping", "of": ["rh_FFJ3"]}, "moves nothing"),
    ],
)
def test_a_space_that_cannot_be_used_says_why(
    entry: dict[str, object], says: str, tmp_path: Path, twin: TwinModel
) -> None:
    with pytest.raises(BadInput, match=says):
        variables_of(load_space(own(tmp_path, parameters=[entry])), twin, ("rh_FFJ3",))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("{", "not readable as YAML"),
        ("- 1", "space.yaml"),
        ("\x00", "not readable as YAML"),
        (yaml.safe_dump({**GOOD, "parameters": [{"kind": "kp", "of": ["moving"], "loewr": 1}]}), "loewr"),
        (yaml.safe_dump({**GOOD, "schema": 2}), "schema"),
    ],
)
def test_a_file_that_is_no_space_says_where(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "space.yaml"
    path.write_text(text)
    with pytest.raises(BadInput, match=says):
        load_space(str(path))


def test_an_unknown_space_names_its_neighbour() -> None:
    with pytest.raises(BadInput, match="Did you mean 'physical'"):
        load_space("phisical")
