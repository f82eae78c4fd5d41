"""Calibration: recordings, a space and a search in; a parameter set with errors and intervals out."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.calibration.spaces import Space, objective_of, variables_of
from twin_daemon.comparison.compare import compare_recording, pooled
from twin_daemon.errors import BadInput, nearest
from twin_daemon.estimation.estimate import Correlated, Estimate
from twin_daemon.estimation.partwise_search import PartwiseSearch
from twin_daemon.estimation.solvers import DESCENTS, SEARCHES, Search
from twin_daemon.estimation.solvers.least_squares import descend
from twin_daemon.estimation.solvers.tracker import Progress, Tracker
from twin_daemon.estimation.subproblems import SubProblem, group_problems, reduced_problems
from twin_daemon.estimation.thresholds import (
    POLISH_ITERATIONS,
    POLISH_SHARE,
)
from twin_daemon.estimation.uncertainty import joint_estimates
from twin_daemon.estimation.variables import OnsetVariable, Remembered, Variable
from twin_daemon.estimation.windows import excerpts
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Calibration:
    """What a calibration found. Errors are mean squared errors in rad^2 over `objective`.

    `before` is the search's start, which is never better than the answer; `given` the twin that was handed in, which
    is another one where the space prescribes a start.
    """

    terms: Terms
    objective: tuple[str, ...]
    before_rad2: float
    after_rad2: float
    holdout_before_rad2: float | None
    holdout_after_rad2: float | None
    given_rad2: float
    holdout_given_rad2: float | None
    parameters: dict[str, Estimate]
    correlations: tuple[Correlated, ...]
    history: list[float]
    evaluations: int
    wall_s: float
    interrupted: bool
    onsets_s: tuple[float, ...]
    not_fitted: tuple[str, ...]
    """Names of what was left as it is, since its part touches something nearly all the time."""


def calibrate(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    space: Space,
    search: str,
    *,
    budget: int | None = None,
    seconds: float | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    remembered: Mapping[str, Remembered] | None = None,
) -> Calibration:
    """Fits the space's parameters to the training recordings and judges them on the held-out ones.

    Parts that touch each other are fitted to the motion in which they touch nothing, and left alone where there is
    none; the errors are those of the whole recordings all the same. The search ends after `budget`
    evaluations or `seconds` of the processor, whichever comes first. Raises BadInput where the search is unknown or
    nothing of the space moves. A KeyboardInterrupt ends the search and keeps the best point.

    `remembered` is what an earlier fit knows of the values by name: a space that anchors its values (`anchor_rad`)
    holds them there unless the recordings say that they have changed.
    """
    if search not in SEARCHES:
        raise BadInput(f"no search '{search}'", todo=nearest(search, SEARCHES))
    began = time.monotonic()
    moving = moving_joints(train)
    if not moving:
        raise BadInput("no joint moves in these recordings", todo="Record a motion, for example twin hand's rich_hand")
    objective = objective_of(space, twin, moving)
    variables = variables_of(space, twin, moving, remembered)
    start = started(twin, space, variables)
    before, began_aligned = judged(start, train, objective)
    aligned = began_aligned
    holdout_before = judged(start, holdout, objective)[0] if holdout else None
    given, holdout_given = before, holdout_before
    if start is not twin:
        given = judged(twin, train, objective)[0]
        holdout_given = judged(twin, holdout, objective)[0] if holdout else None

    found = PartwiseSearch(progress)
    problems: list[SubProblem] = []
    grouped: list[SubProblem] = []

    def current() -> TwinModel:
        terms = start.terms
        for sub in problems:
            terms = sub.added_to(terms, found.units)
        return twin.changed(terms)

    interrupted = False
    try:
        if search in DESCENTS:
            grouped = group_problems(start, excerpts(aligned), variables, objective, prior_weight=space.anchor_rad)
        for stage, evaluations, time_s in _stages(search, train, budget, seconds, polished=bool(grouped)):
            if grouped:
                problems, grouped = grouped, []
                try:
                    found.run(problems, stage, evaluations, seed, time_s)
                finally:
                    found.history = [before] * len(found.history)  # of the whole nothing better is known
                continue
            if found.units:
                aligned = judged(current(), train, objective)[1]
            descends = search in DESCENTS
            problems = reduced_problems(
                start,
                excerpts(aligned),
                variables,
                objective,
                separable=descends,
                free_onsets=descends and stage is not _polish,
                prior_weight=space.anchor_rad,
            )
            found.run(problems, stage, evaluations, seed, time_s)
    except KeyboardInterrupt:
        if not found.units:  # nothing has been evaluated yet: there is nothing to keep
            raise
        interrupted = True
    fitted = current()
    after, aligned = judged(fitted, train, objective)
    if not after <= before:
        # searched were excerpts of parts, with onsets as they were: what was best there need not be best of all
        fitted, after, aligned = start, before, began_aligned
        found.units = {}
    if found.history and after < found.history[-1]:
        found.history[-1] = after  # a search joint by joint that was interrupted knows nothing of the whole
    parameters, correlations = _fitted(problems, found.units)
    searched = {variable.name for sub in problems for variable in sub.problem.variables}
    return Calibration(
        terms=fitted.terms,
        objective=objective,
        before_rad2=before,
        after_rad2=after,
        holdout_before_rad2=holdout_before,
        holdout_after_rad2=judged(fitted, holdout, objective)[0] if holdout else None,
        given_rad2=given,
        holdout_given_rad2=holdout_given,
        parameters=parameters,
        correlations=correlations,
        history=found.history,
        evaluations=len(found.history),
        wall_s=time.monotonic() - began,
        interrupted=interrupted,
        onsets_s=tuple(r.onset_s for r in aligned),
        not_fitted=tuple(variable.name for variable in variables if problems and variable.name not in searched),
    )


def _stages(
    search: str, train: Sequence[Aligned], budget: int | None, seconds: float | None, *, polished: bool
) -> list[tuple[Search, int | None, float | None]]:
    """The searches to run, each with its budget and its time.

    An estimated onset depends on the parameters and they on it: search, align anew, polish. What was searched joint by
    joint is `polished` as well, with all joints of a part in one roll-out.
    """
    if search not in DESCENTS or not (polished or any(r.onset_free for r in train)):
        return [(SEARCHES[search], budget, seconds)]
    last = None if budget is None else int(POLISH_SHARE * budget)
    if last == 0:
        return [(SEARCHES[search], budget, seconds)]
    first = None if budget is None or last is None else budget - last
    last_s = None if seconds is None else POLISH_SHARE * seconds
    first_s = None if seconds is None or last_s is None else seconds - last_s
    return [(SEARCHES[search], first, first_s), (_polish, last, last_s)]


def _polish(tracker: Tracker, budget: int | None, seed: int) -> None:
    descend(tracker, tracker.problem.start, POLISH_ITERATIONS)


def started(twin: TwinModel, space: Space, variables: Sequence[Variable]) -> TwinModel:
    """The twin at the start that the space prescribes; the twin itself where it prescribes none."""
    if not any(entry.start is not None for entry in space.parameters):
        return twin
    values = {name: v.start for v in variables for name in v.parameters_moved}
    return twin.changed(twin.terms.with_parameters(values))


def judged(twin: TwinModel, recordings: Sequence[Aligned], objective: Sequence[str]) -> tuple[float, list[Aligned]]:
    """(mean squared error in rad^2 over the objective's joints, the recordings aligned to this twin)."""
    comparisons = [compare_recording(twin, r) for r in recordings]
    joints = pooled(comparisons)
    values = [joints[name].mse_rad2 for name in objective if name in joints]
    return float(np.mean(values)), [c.aligned for c in comparisons]


def _fitted(
    problems: Sequence[SubProblem], units: dict[str, float]
) -> tuple[dict[str, Estimate], tuple[Correlated, ...]]:
    found: dict[str, Estimate] = {}
    correlations: list[Correlated] = []
    for sub in problems:
        values, correlation = joint_estimates(sub.problem, sub.start(units))
        own = [i for i, variable in enumerate(sub.problem.variables) if not isinstance(variable, OnsetVariable)]
        names = tuple(sub.problem.variables[i].name for i in own)
        found |= {name: values[i] for name, i in zip(names, own, strict=True)}
        correlations.append((names, correlation[np.ix_(own, own)]))
    return found, tuple(correlations)
