"""Fingers that touch each other are fitted by the motion in which they do not."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded
from twin_daemon.calibration.calibrate import calibrate
from twin_daemon.calibration.spaces import load_space, variables_of
from twin_daemon.estimation.partition import Reduction
from twin_daemon.estimation.partwise_search import PartwiseSearch
from twin_daemon.estimation.solvers.least_squares import descend
from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.subproblems import reduced_problems, touching
from twin_daemon.estimation.variables import Variable
from twin_daemon.recalibration.clear_errors import clear_residuals
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

# Both fingers move on their own, are pushed against each other from 6 to 7 s, and move on.
_BASE_S = [0, 0.5, 1.2, 2.0, 2.01, 3.0, 4.0, 5.5, 8.0, 8.6, 9.5, 10.5]
_BASE_RAD = [0.1, 0.1, 1.0, 1.0, 0.5, 0.9, 0.2, 0.1, 0.1, 1.1, 0.3, 0.3]
_SIDE_S = [0, 5.6, 6.0, 7.0, 7.4, 10.5]
MOTION: Motion = {
    "rh_FFJ3": (_BASE_S, _BASE_RAD),
    "rh_MFJ3": (_BASE_S, _BASE_RAD[::-1]),
    "rh_FFJ4": (_SIDE_S, [0.0, 0.0, 0.34, 0.34, 0.0, 0.0]),
    "rh_MFJ4": (_SIDE_S, [0.0, 0.0, -0.34, -0.34, 0.0, 0.0]),
}
MOVING = tuple(MOTION)


@pytest.fixture(scope="module")
def worn(twin: TwinModel) -> TwinModel:
    damping = 4.0 * twin.parameter("rh_FFJ3.damping").read(twin.model)
    return twin.changed(Terms(parameters={"rh_FFJ3.damping": damping}))


@pytest.fixture(scope="module")
def aligned(twin: TwinModel, worn: TwinModel) -> Aligned:
    return align(twin, recorded(worn, MOTION, np.random.default_rng(3), seconds=10.5))


def test_how_much_of_its_motion_a_finger_touches_another_is_known(twin: TwinModel, aligned: Aligned) -> None:
    reduction = Reduction(twin, [aligned], [])
    assert 0.5 / 10.5 < reduction.share_touching(("rh_FFJ3",)) < 2.0 / 10.5  # from 6 to 7 s, and while they come near
    assert reduction.share_touching(("rh_THJ4",)) == 0.0


def _variables(twin: TwinModel) -> list[Variable]:
    return list(variables_of(load_space("wear"), twin, MOVING))


@pytest.mark.parametrize(("separable", "problems"), [(False, 1), (True, 2)])
def test_each_has_a_problem_of_its_own(twin: TwinModel, aligned: Aligned, separable: bool, problems: int) -> None:
    """A touch somewhere does not make one problem of the whole hand, unless the search is one over all values."""
    assert touching(twin, aligned)
    found = reduced_problems(twin, [aligned], _variables(twin), MOVING, separable=separable)
    assert len(found) == problems
    assert sum(sub.weight for sub in found) == pytest.approx(1.0)


def test_parts_are_searched_side_by_side_as_one_after_another(
    twin: TwinModel, aligned: Aligned, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same values and the same falling error, to the last bit, and how far they are is told meanwhile."""
    problems = reduced_problems(twin, [aligned], _variables(twin), MOVING, separable=True)
    found: list[PartwiseSearch] = []
    told: list[tuple[int, float]] = []
    for cores in ("1", "2"):
        monkeypatch.setenv("TWIN_THREADS", cores)
        told.clear()
        found.append(PartwiseSearch(lambda count, mse: told.append((count, mse))))
        found[-1].run(problems, _some_steps, None, 0)
    in_turn, side_by_side = found
    assert in_turn.units == side_by_side.units
    assert in_turn.history == side_by_side.history
    assert in_turn.history[-1] < in_turn.history[0]
    counts, errors = zip(*told, strict=True)
    assert sorted(counts) == list(counts)
    assert sorted(errors, reverse=True) == list(errors)
    assert (counts[-1], errors[-1]) == (len(side_by_side.history), pytest.approx(side_by_side.history[-1]))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are forked on Linux alone")
def test_an_interrupt_keeps_what_processes_have_found_that_are_still_at_it(
    twin: TwinModel, aligned: Aligned, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TWIN_THREADS", "2")
    problems = reduced_problems(twin, [aligned], _variables(twin), MOVING, separable=True)
    at_start = sum(sub.weight * float(sub.problem.mse(sub.start({})[None])[0]) for sub in problems)

    def then_waits(tracker: Tracker, budget: int | None, seed: int) -> None:
        _some_steps(tracker, budget, seed)
        time.sleep(60.0)

    def stop(count: int, mse: float) -> None:
        if mse < 0.9 * at_start:
            raise KeyboardInterrupt

    found = PartwiseSearch(stop)
    with pytest.raises(KeyboardInterrupt):
        found.run(problems, then_waits, None, 0)
    kept = sum(sub.weight * float(sub.problem.mse(sub.start(found.units)[None])[0]) for sub in problems)
    assert kept == pytest.approx(found.history[-1])
    assert kept < 0.9 * at_start


def _some_steps(tracker: Tracker, budget: int | None, seed: int) -> None:
    descend(tracker, tracker.problem.start, 3)


@pytest.mark.slow
def test_the_worn_one_is_found_beside_the_contact(twin: TwinModel, worn: TwinModel, aligned: Aligned) -> None:
    found = calibrate(twin, [aligned], [], load_space("wear"), "bayes-descent", seconds=10.0)
    planted = worn.parameter("rh_FFJ3.damping").read(worn.model)
    assert found.parameters["rh_FFJ3.damping"].value == pytest.approx(planted, rel=0.06)


def test_errors_leave_the_contact_out_and_tell_two_twins_apart(
    twin: TwinModel, worn: TwinModel, aligned: Aligned
) -> None:
    ((nominal, right),) = clear_residuals((twin, worn), [aligned])
    columns = [aligned.joints.index(name) for name in MOVING]
    pushed = (aligned.time_s > 6.1) & (aligned.time_s < 6.9)
    for residual in (nominal, right):
        assert np.isnan(residual[np.ix_(pushed, columns)]).all()
    worst = [float(np.nanmax(np.abs(r[:, aligned.joints.index("rh_FFJ3")]))) for r in (nominal, right)]
    assert worst[0] > 0.05
    assert worst[1] < 0.005


@pytest.mark.slow
def test_what_never_moves_clear_of_a_contact_is_left_as_it_is_and_named(twin: TwinModel) -> None:
    pushed = {"rh_FFJ4": ([0.0, 6.0], [0.34, 0.34]), "rh_MFJ4": ([0.0, 6.0], [-0.34, -0.34])}
    bent = ([0, 0.5, 1.2, 2.0, 2.01, 3.0, 4.0, 5.5], [0.4, 0.4, 0.5, 0.5, 0.45, 0.55, 0.4, 0.4])
    motion: Motion = {**pushed, "rh_FFJ3": bent, "rh_MFJ3": bent, "rh_LFJ3": (_BASE_S, _BASE_RAD)}
    aligned = align(twin, recorded(twin, motion, np.random.default_rng(3), seconds=6.0))
    found = calibrate(twin, [aligned], [], load_space("wear"), "bayes-descent", budget=40)
    assert any(name.startswith("rh_LFJ3") for name in found.parameters)
    assert {"rh_FFJ3.damping", "rh_MFJ3.damping"} <= set(found.not_fitted)
    assert not any("rh_LFJ3" in name for name in found.not_fitted)
    assert not set(found.not_fitted) & set(found.parameters)
