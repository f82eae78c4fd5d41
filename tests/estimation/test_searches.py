"""Four searches, one promise: the error falls, the budget holds, the seed decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.calibration.calibrate import Calibration, calibrate
from twin_daemon.calibration.spaces import Space, variables_of
from twin_daemon.errors import BadInput
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.solvers import SEARCHES
from twin_daemon.estimation.solvers.tracker import BudgetSpent, Tracker
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

SPACE = Space.model_validate(
    {
        "schema": 1,
        "name": "small",
        "about": "two gains and a damping",
        "parameters": [
            {"kind": "kp", "of": ["rh_FFJ0", "rh_FFJ3"], "lower": 0.1, "upper": 100.0},
            {"kind": "damping", "of": ["rh_FFJ3"], "lower": 0.001, "upper": 5.0},
        ],
    }
)
BUDGET = 40


@pytest.fixture(scope="module")
def worn(twin: TwinModel) -> Aligned:
    wear = {"rh_FFJ0.kp": 0.3, "rh_FFJ3.damping": 6.0}
    values = {name: factor * twin.parameter(name).read(twin.model) for name, factor in wear.items()}
    return align(twin, recorded(twin.changed(Terms(parameters=values)), FINGER, np.random.default_rng(5)))


def run(search: str, twin: TwinModel, worn: Aligned, seed: int = 0) -> Calibration:
    return calibrate(twin, [worn], [], SPACE, search, budget=BUDGET, seed=seed)


@pytest.mark.parametrize(
    "search", [pytest.param(name, marks=pytest.mark.slow) if "bayes" in name else name for name in SEARCHES]
)
def test_a_search_lowers_the_error_within_its_budget_and_the_same_twice(
    search: str, twin: TwinModel, worn: Aligned
) -> None:
    one, two = (run(search, twin, worn, seed=7) for _ in range(2))
    assert one.after_rad2 < 0.7 * one.before_rad2
    assert 0 < one.evaluations <= BUDGET
    assert one.history == two.history
    assert one.terms == two.terms


def test_an_answer_is_never_worse_than_its_start(twin: TwinModel) -> None:
    """A worn hand moves once in the stretches that stand for a long recording, a sound one twice between them."""
    damping = "rh_FFJ3.damping"
    now = twin.parameter(damping).read(twin.model)
    three = {
        name: ([late_s + at_s for late_s in (0.0, 8.05, 21.05) for at_s in times], list(values) * 3)
        for name, (times, values) in FINGER.items()
    }
    sound, worn = (
        align(twin, recorded(hand, three, np.random.default_rng(5), seconds=60.0))
        for hand in (twin, twin.changed(Terms(parameters={damping: 6.0 * now})))
    )
    measured = np.where((sound.time_s < 8.0)[:, None], worn.measured, sound.measured)
    space = SPACE.model_copy(update={"parameters": SPACE.parameters[1:]})
    found = calibrate(twin, [replace(sound, measured=measured)], [], space, "random", budget=5)
    assert found.history[-1] < 0.9 * found.history[0], "the search thought that it had found something"
    assert found.after_rad2 == found.before_rad2
    assert found.terms == twin.terms
    assert found.parameters[damping].value == pytest.approx(now)


@pytest.mark.parametrize("search", ["random", "pso"])
def test_another_seed_is_another_search(search: str, twin: TwinModel, worn: Aligned) -> None:
    assert run(search, twin, worn, seed=1).history != run(search, twin, worn, seed=2).history


def test_progress_tells_the_best_so_far(twin: TwinModel, worn: Aligned) -> None:
    told: list[tuple[int, float]] = []
    result = calibrate(
        twin, [worn], [], SPACE, "random", budget=25, progress=lambda count, mse: told.append((count, mse))
    )
    assert [count for count, _ in told] == [20, 25]
    assert told[-1][1] == pytest.approx(result.history[-1])


@pytest.mark.parametrize(
    "search",
    [pytest.param(name, marks=pytest.mark.slow) if name in ("bayes", "multi-start") else name for name in SEARCHES],
)
def test_an_interrupt_keeps_the_best(search: str, twin: TwinModel, worn: Aligned) -> None:
    def stop(count: int, mse: float) -> None:
        if count >= 20:
            raise KeyboardInterrupt

    result = calibrate(twin, [worn], [], SPACE, search, seed=3, progress=stop)
    assert result.interrupted
    assert result.after_rad2 <= result.before_rad2
    assert result.after_rad2 == pytest.approx(result.history[-1], rel=1e-3)


def test_a_budget_is_spent_to_the_last_evaluation_and_no_further(twin: TwinModel, worn: Aligned) -> None:
    problem = Problem(twin, [worn], variables_of(SPACE, twin, ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3")), ["rh_FFJ3"])
    tracker = Tracker(problem, budget=3)
    points = np.tile(problem.start, (2, 1))
    tracker.cost(points)
    with pytest.raises(BudgetSpent):
        tracker.cost(points)
    assert len(tracker.history) == 3


def test_time_that_is_spent_ends_a_search_after_its_first_evaluation(twin: TwinModel, worn: Aligned) -> None:
    problem = Problem(twin, [worn], variables_of(SPACE, twin, ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3")), ["rh_FFJ3"])
    tracker = Tracker(problem, seconds=0.0)
    tracker.cost(problem.start[None])
    with pytest.raises(BudgetSpent):
        tracker.cost(problem.start[None])


@pytest.mark.parametrize("search", ["random", "least-squares"])
def test_a_search_without_time_keeps_what_it_has_and_was_not_interrupted(
    search: str, twin: TwinModel, worn: Aligned
) -> None:
    result = calibrate(twin, [worn], [], SPACE, search, budget=200, seconds=1e-3)
    assert 0 < result.evaluations < 100
    assert result.after_rad2 <= result.before_rad2
    assert not result.interrupted


def test_an_unknown_search_names_its_neighbour(twin: TwinModel, worn: Aligned) -> None:
    with pytest.raises(BadInput, match="Did you mean 'random'"):
        run("randm", twin, worn)
