"""What a diagnosis may conclude from what is left, what has moved, and what the motion could have shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.diagnosis.conftest import JOINT, called
from tests.diagnosis.findings import finding
from tests.simulation.made import FINGER
from tests.simulation.made import recorded as moved_finger
from twin_daemon.diagnosis.as_fitted import as_fitted, with_values
from twin_daemon.diagnosis.conclude import Outcome, conclude
from twin_daemon.diagnosis.fit import moved_parameters
from twin_daemon.diagnosis.left_out import LeftOut
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.estimation.nuisances import beside, factors, nuisance_variables
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Descent, searched
from twin_daemon.estimation.variables import ParameterVariable
from twin_daemon.places import ROBOT
from twin_daemon.signals.trajectory import Trajectory, load_trajectory
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import Part
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel


def test_a_slow_closing_shows_too_little_to_call_a_hand_sound(
    recorded: Callable[..., Path], tmp_path: Path, hand: Any
) -> None:
    closing = Trajectory("slow", (JOINT,), np.array([0.0, 0.2, 3.2, 3.4]), np.array([[0.0], [0.0], [0.08], [0.08]]))
    fitted, held = (str(recorded(f"slow_{seed}", closing, seed=seed)) for seed in (1, 2))
    said = called(
        "diagnose", "--recording", fitted, "--holdout", held, "--joints", JOINT, result=tmp_path / "slow.json"
    )
    assert (said["verdict"], said["findings"]) == ("not_excited", [])
    assert "viscous_friction" in said["reason"]
    assert "steps" in said["reason"]
    assert JOINT in load_trajectory(said["next_experiment"]["trajectory"], hand).joints


@pytest.mark.parametrize(("sigma", "verdict"), [(8.7, "unexplained"), (4.5, "within_noise")])
def test_a_parameter_beyond_any_plausible_hand_is_no_noise(twin: TwinModel, sigma: float, verdict: str) -> None:
    outcome = Outcome("FF", (JOINT,), 0.4, {f"{JOINT}.armature": sigma}, left=0.3)
    said = conclude(twin, (), [outcome], LeftOut(), False)
    assert said.verdict == verdict
    assert (f"{JOINT}.armature" in said.reason) == (verdict == "unexplained")


@pytest.mark.parametrize(("sigma", "verdict"), [(9.0, "ambiguous"), (1.0, "explained")])
def test_a_cause_that_groups_share_is_no_surer_than_the_worst_of_them(
    twin: TwinModel, sigma: float, verdict: str
) -> None:
    """A value that has to be far off beside it may stand in for a law that is not known."""
    cause = finding("viscous_friction", ROBOT, (JOINT,), "").model_copy(
        update={"confusable_with": (), "probability": 1.0}
    )
    outcome = Outcome("FF", (JOINT,), 0.4, {f"{JOINT}.armature": sigma}, within_floor=True)
    said = conclude(twin, (), [outcome], LeftOut(), False, [cause], [{cause.name: 1.0}])
    assert said.verdict == verdict


@pytest.mark.parametrize(
    ("chi_square", "left", "verdict"),
    [(0.4, 1.1, "within_noise"), (0.4, 1.3, "unexplained"), (4.0, 1.1, "unexplained")],
)
def test_held_out_motion_alone_asks_for_more_to_be_a_new_law(
    twin: TwinModel, chi_square: float, left: float, verdict: str
) -> None:
    said = conclude(twin, (), [Outcome("FF", (JOINT,), chi_square, {}, left=left)], LeftOut(), False)
    assert said.verdict == verdict


def test_much_motion_that_is_left_out_for_what_it_touches_is_said(twin: TwinModel) -> None:
    outcome = Outcome("FF", (JOINT,), 0.5, {}, within_floor=True)
    left_out = LeftOut(touching={"LF": ("rh_LFJ3",)}, shares={"FF": 0.62, "MF": 0.3}, near=["RF"])
    said = conclude(twin, (), [outcome], left_out, False)
    assert any("LF" in note for note in said.notes)
    assert any("FF (62%)" in note for note in said.notes)
    assert any("RF: seen only" in note for note in said.notes)
    assert not any("MF" in note for note in said.notes)


def test_a_joint_that_touches_something_all_the_time_is_no_noise_where_it_is_far_beyond_all_others() -> None:
    left_out = LeftOut(touching={"FF": ("rh_FFJ3", "rh_FFJ4")})
    rms_rad = {"rh_FFJ3": 0.097, "rh_FFJ4": 0.004, "rh_MFJ3": 0.002, "rh_WRJ1": 0.2}
    assert left_out.far_off(rms_rad, {"rh_MFJ3"}) == {"rh_FFJ3": 0.097}
    assert left_out.far_off(rms_rad, {"rh_MFJ3", "rh_WRJ1"}) == {}
    assert LeftOut().far_off(rms_rad, {"rh_MFJ3"}) == {}


@pytest.mark.parametrize(("parts", "verdict"), [(("poor",), "not_excited"), (("poor", "rich"), "within_noise")])
def test_one_part_that_moved_richly_makes_a_hand_sound(twin: TwinModel, parts: tuple[str, ...], verdict: str) -> None:
    outcomes = [Outcome(name, (JOINT,), 0.5, {}, within_floor=True) for name in parts]
    outcomes[0].undetectable = [f"armature:{JOINT}", f"actuator_lag:{JOINT}"]
    assert conclude(twin, (), outcomes, LeftOut(), False).verdict == verdict


def test_a_damping_that_is_off_but_plausible_is_said_with_its_value(twin: TwinModel) -> None:
    worn = twin.changed(
        Terms(parameters={f"{JOINT}.damping": 1.4 * twin.parameter(f"{JOINT}.damping").read(twin.model)})
    )
    aligned = align(twin, moved_finger(worn, FINGER, np.random.default_rng(2)))
    reduced = Reduction(twin, [aligned], []).of(twin, Part(JOINT, (JOINT,), ()), (JOINT,))
    assert reduced is not None
    found = moved_parameters(PartFit(reduced.twin, reduced.train, (JOINT,)).base)
    assert [one.parameter for one in found] == [f"{JOINT}.damping"]
    assert found[0].of_nominal == pytest.approx(1.4, abs=0.08)
    assert found[0].of_nominal_ci95 is not None
    assert 1.0 < found[0].of_nominal_ci95[0] < 1.4 < found[0].of_nominal_ci95[1]
    assert f"{JOINT}.damping is {found[0].of_nominal:.2f} of nominal (" in str(found[0])
    assert "not beyond what nominal values are known to (12%)" in str(found[0])


def test_an_effects_value_counts_from_what_the_model_states(twin: TwinModel) -> None:
    variables = nuisance_variables(twin, (), (JOINT,))
    values = {variable.name: 1.5 if variable.name == f"{JOINT}.kp" else 2.0 for variable in variables}
    assert factors(variables, values)[f"{JOINT}.armature"] == 3.0
    left = beside(variables, {f"{JOINT}.armature"})
    assert {k.name for k in variables} - {k.name for k in left} == {f"{JOINT}.armature"}
    assert f"{JOINT}.armature" not in factors(left, values)
    assert factors(left, values)[f"{JOINT}.damping"] == 3.0


def test_beside_what_all_joints_have_each_may_have_its_own_share_of_it(twin: TwinModel) -> None:
    def sigmas(twin: TwinModel) -> dict[str, float]:
        return {v.name: v.prior.sigma for v in nuisance_variables(twin, (), (JOINT,)) if v.prior is not None}

    cold = EffectTerm(effect="coulomb_friction", target=ROBOT, values={"friction": 0.0, "share": 9.0})
    usual, wider = sigmas(twin), sigmas(twin.changed(Terms(effects=(cold,))))
    name = f"{JOINT}.frictionloss"
    assert wider[name] == pytest.approx(np.hypot(usual[name], 0.1 * np.log(10.0)))
    assert {key: value for key, value in wider.items() if key != name} == {k: v for k, v in usual.items() if k != name}


def test_what_a_fit_beside_a_missing_effect_comes_to_is_still_a_model(twin: TwinModel) -> None:
    """A limit of speed takes all friction of a joint away; nothing less than the least is written into the model."""
    name = f"{JOINT}.frictionloss"
    least = twin.parameter(name).kind.lower
    smooth = twin.changed(Terms(parameters={name: 3.0 * least}))
    variable = ParameterVariable(name, "1", 1e-2, 1e2, 1.0, True, parameters=(name,), factor=True)
    fit = SimpleNamespace(problem=SimpleNamespace(variables=[variable]), point=np.zeros(1))
    fitted = with_values(
        smooth, as_fitted(smooth, [(cast("Reduced", None), cast("PartFit", SimpleNamespace(base=fit)))])
    )
    assert fitted.parameter(name).read(fitted.model) == pytest.approx(least)


def test_what_an_effect_multiplies_is_not_counted_twice_where_a_fit_has_come_to(twin: TwinModel) -> None:
    name = f"{JOINT}.damping"
    cold = EffectTerm(effect="viscous_friction", target=ROBOT, values={"damping": 0.0, "share": 1.0})
    changed = twin.changed(Terms(effects=(cold,)))
    variable = ParameterVariable(name, "1", 0.1, 1.0, 1.0, True, parameters=(name,), factor=True)
    fit = SimpleNamespace(problem=SimpleNamespace(variables=[variable]), point=np.ones(1))
    group = (cast("Reduced", None), cast("PartFit", SimpleNamespace(base=fit)))
    fitted = with_values(changed, as_fitted(changed, [group]))
    assert fitted.model.dof_damping == pytest.approx(changed.model.dof_damping)


def test_a_pattern_search_gets_across_corners_at_which_a_descent_ends() -> None:
    def residuals(points: np.ndarray) -> np.ndarray:
        away = points[:, 0] - 0.5
        return np.stack([away + 0.004 * np.sin(400.0 * away), points[:, 1] - 2.0 * away - 0.3], axis=1)

    variables = [ParameterVariable(name, "1", 0.0, 1.0, 0.5) for name in ("effect:there.size", "nuisance")]
    problem = cast("Posterior", SimpleNamespace(variables=variables, residuals=residuals))
    start = np.array([0.44, 0.0])
    stopped = Descent(start, residuals(start[None])[0], np.array([[0.0, 0.0], [0.0, 1.0]]), 1.0)
    reached = searched(problem, stopped, (0,))
    assert reached.point == pytest.approx([0.5, 0.3], abs=0.01)
    assert reached.rows @ reached.rows < 1e-4
