"""Calibration: recordings, a space and a search in; a parameter set with errors and intervals out."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin_daemon.comparison.compare import compare_recording, pooled
from twin_daemon.errors import BadInput, nearest
from twin_daemon.fitting.intervals import Interval, intervals
from twin_daemon.fitting.knobs import Knob
from twin_daemon.fitting.problem import Problem
from twin_daemon.fitting.reduce import SubProblem, reduced_problems
from twin_daemon.fitting.searches import SEARCHES
from twin_daemon.fitting.searches.least_squares import descend
from twin_daemon.fitting.spaces import Space, knobs_of, objective_of
from twin_daemon.fitting.tracker import Progress, Tracker
from twin_daemon.simulation.alignment import Aligned, model_onset
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

_POLISH = "polish"  # the onset depends on the parameters and they on it: fit, align anew, polish


@dataclass(frozen=True)
class FittedParameter:
    """One fitted number with what is known of it."""

    value: float
    unit: str
    lower: float
    upper: float
    at_bound: bool
    interval: Interval


@dataclass(frozen=True)
class Calibration:
    """What a calibration found. Errors are mean squared errors in rad^2 over `objective`."""

    terms: Terms
    objective: tuple[str, ...]
    before_rad2: float
    after_rad2: float
    holdout_before_rad2: float | None
    holdout_after_rad2: float | None
    parameters: dict[str, FittedParameter]
    history: list[float]
    evaluations: int
    wall_s: float
    interrupted: bool
    onsets_s: tuple[float, ...]
    notes: list[str] = field(default_factory=list)


def calibrate(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    space: Space,
    search: str,
    *,
    budget: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Calibration:
    """Fits the space's parameters to the training recordings and judges them on the held-out ones.

    Raises BadInput where the search is unknown or nothing of the space moves. A KeyboardInterrupt ends the
    search and keeps the best point.
    """
    if search not in SEARCHES:
        raise BadInput(f"no search '{search}'", todo=nearest(search, SEARCHES))
    began = time.monotonic()
    moving = tuple(name for i, name in enumerate(twin.joints) if any(r.moving[i] for r in train))
    if not moving:
        raise BadInput("no joint moves in these recordings", todo="Record a motion, for example twin hand's rich_hand")
    objective = objective_of(space, twin, moving)
    knobs = knobs_of(space, twin, moving)
    start = started(twin, space, knobs)
    before = error(start, train, objective)
    holdout_before = error(start, holdout, objective) if holdout else None

    again = search == "least-squares" and any(r.onset_free for r in train)
    history: list[float] = []
    units: dict[str, float] = {}
    interrupted = False
    current, problems = start, []
    for step in (search, _POLISH) if again else (search,):
        aligned = [r.with_onset(model_onset(current, r)) if r.onset_free else r for r in train]
        problems = reduced_problems(start, aligned, knobs, objective, separable=search == "least-squares")
        try:
            units = _run(problems, step, budget, seed, progress, history, units)
        except _Interrupted as stop:
            units, interrupted = stop.units, True
        found = {name: value for p in problems for name, value in p.parameters(units).items()}
        current = twin.changed(start.terms.with_parameters(found))
        if interrupted:
            break
    final = [r.with_onset(model_onset(current, r)) if r.onset_free else r for r in train]
    parameters = _fitted(problems, units)
    return Calibration(
        terms=current.terms,
        objective=objective,
        before_rad2=before,
        after_rad2=error(current, final, objective),
        holdout_before_rad2=holdout_before,
        holdout_after_rad2=error(current, holdout, objective) if holdout else None,
        parameters=parameters,
        history=history,
        evaluations=len(history),
        wall_s=time.monotonic() - began,
        interrupted=interrupted,
        onsets_s=tuple(r.onset_s for r in final),
    )


def started(twin: TwinModel, space: Space, knobs: Sequence[Knob]) -> TwinModel:
    """The twin at the start that the space prescribes; the twin itself where it prescribes none."""
    if not any(entry.start is not None for entry in space.parameters):
        return twin
    values = {w[1]: k.start for k in knobs for w in k.writes if w[0] == "parameter"}
    return twin.changed(twin.terms.with_parameters(values))


def error(twin: TwinModel, recordings: Sequence[Aligned], objective: Sequence[str]) -> float:
    """Mean squared error (rad^2) over the objective's joints, recordings weighted by their samples."""
    joints = pooled([compare_recording(twin, r) for r in recordings])
    values = [joints[name].mse_rad2 for name in objective if name in joints]
    return float(np.mean(values))


_POLISH_ITERATIONS = 10


class _Interrupted(Exception):
    def __init__(self, units: dict[str, float]) -> None:
        self.units = units


def _run(
    problems: Sequence[SubProblem],
    search: str,
    budget: int | None,
    seed: int,
    progress: Progress | None,
    history: list[float],
    earlier: dict[str, float],
) -> dict[str, float]:
    """Searches one sub-problem after another; the history is of their weighted sum, as one falling curve."""
    units = dict(earlier)
    best = {i: float("nan") for i in range(len(problems))}
    for i, sub in enumerate(problems):
        best[i] = float(sub.problem.mse(sub.start(units)[None])[0]) * sub.weight
    share = None if budget is None else max(1, budget // len(problems))
    for i, sub in enumerate(problems):
        others = sum(value for j, value in best.items() if j != i)

        def report(_: int, mse: float, weight: float = sub.weight, others: float = others) -> None:
            if progress is not None:
                progress(len(history) + len(tracker.history), mse * weight + others)

        problem = _restarted(sub, units)
        tracker = Tracker(problem, report)
        stopped = False
        try:
            if search == _POLISH:
                descend(tracker, problem.start, _POLISH_ITERATIONS)
            else:
                SEARCHES[search](tracker, share, seed)
        except KeyboardInterrupt:
            stopped = True
        if np.isfinite(tracker.best_mse):
            units.update(zip((k.name for k in problem.knobs), map(float, tracker.best), strict=True))
            best[i] = tracker.best_mse * sub.weight
        history.extend(_falling(history, [mse * sub.weight + others for mse in tracker.history]))
        if stopped:
            raise _Interrupted(units)
    return units


def _restarted(sub: SubProblem, units: dict[str, float]) -> Problem:
    values = sub.problem.values(sub.start(units))
    knobs = tuple(replace(k, start=float(v)) for k, v in zip(sub.problem.knobs, values, strict=True))
    p = sub.problem
    return Problem(p.twin, p.recordings, knobs, p.objective, threads=p.threads)


def _falling(history: list[float], new: list[float]) -> list[float]:
    return list(np.minimum.accumulate([*history[-1:], *new]))[len(history[-1:]) :]


def _fitted(problems: Sequence[SubProblem], units: dict[str, float]) -> dict[str, FittedParameter]:
    out = {}
    for sub in problems:
        point = sub.start(units)
        spans = intervals(sub.problem, point)
        for knob, unit, span in zip(sub.problem.knobs, point, spans, strict=True):
            value = knob.value(unit)
            out[knob.name] = FittedParameter(value, knob.unit, knob.lower, knob.upper, knob.at_bound(value), span)
    return out
