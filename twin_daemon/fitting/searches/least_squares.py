"""Bounded least squares from several starts (`mujoco.minimize`), Jacobians by batches of roll-outs.

One start is a trap: on a real hand starts differ by more than searches do. The starts are the model itself and
the best of a space-filling sample around it.
"""

from __future__ import annotations

import contextlib

import numpy as np
from mujoco import minimize
from scipy.stats import qmc

from twin_daemon.fitting.tracker import Tracker

_STARTS = 3
_SAMPLES = 64
_ITERATIONS = 40
_ROUGH_ITERATIONS = 6
_STEP = 1e-3  # of the box: steps over what friction and a delay buffer make rough
_STALLED = 3e-3  # a relative gain below this in each of the last iterations: it has arrived
_PATIENCE = 3


def least_squares(tracker: Tracker, budget: int | None, seed: int) -> None:
    """From several starts; `budget` bounds the evaluations, by default until every start has converged."""
    problem = tracker.problem
    start = problem.start
    sample = qmc.Sobol(len(start), seed=seed).random(_SAMPLES)
    # half of the sample stays near the model, which is seldom wrong by the whole box
    sample[::2] = np.clip(start + 0.3 * (sample[::2] - 0.5), 0.0, 1.0)
    costs = tracker.cost(sample)
    starts = [start, *sample[np.argsort(costs)[: _STARTS - 1]]]
    limit = np.inf if budget is None else budget
    ends = []
    for point in starts:
        if len(tracker.history) < limit:
            ends.append(descend(tracker, point, _ROUGH_ITERATIONS, limit))
    ends.sort(key=lambda end: end[1])
    for point, _ in ends[:1]:
        if len(tracker.history) < limit:
            descend(tracker, point, _ITERATIONS, limit)


class _Ended(Exception):
    """The descent is over: its budget is spent, or it has arrived."""


def descend(
    tracker: Tracker, start: np.ndarray, iterations: int, limit: float = np.inf
) -> tuple[np.ndarray, float]:
    """One bounded Levenberg-Marquardt descent: (end point, its cost). Ends early where the limit is reached."""
    best = [np.array(start), np.inf]

    def residual(columns: np.ndarray) -> np.ndarray:
        if len(tracker.history) >= limit:
            raise _Ended
        rows = tracker.residuals(np.atleast_2d(columns.T))
        cost = (rows**2).sum(axis=1)
        index = int(np.argmin(cost))
        if cost[index] < best[1]:
            best[:] = [np.clip(np.atleast_2d(columns.T)[index], 0.0, 1.0), float(cost[index])]
        return rows.T

    def stop_when_stalled(trace: list) -> None:
        costs = [entry.objective for entry in trace[-_PATIENCE - 1 :]]
        if len(costs) > _PATIENCE and costs[0] - costs[-1] < _STALLED * abs(costs[0]):
            raise _Ended

    bounds = [np.zeros(len(start)), np.ones(len(start))]
    with contextlib.suppress(_Ended):
        minimize.least_squares(
            np.clip(start, 0.0, 1.0),
            residual,
            bounds=bounds,
            eps=_STEP,
            max_iter=iterations,
            xtol=1e-5,
            gtol=1e-10,
            iter_callback=stop_when_stalled,
            verbose=minimize.Verbosity.SILENT,
        )
    return best[0], best[1]


def jacobian(tracker: Tracker, point: np.ndarray, step: float = 1e-2) -> np.ndarray:
    """(m, p) derivative of the residuals by the unit coordinates: central where the box allows, else one-sided."""
    identity = np.eye(len(point)) * step
    upper = np.clip(point + identity, 0.0, 1.0)
    lower = np.clip(point - identity, 0.0, 1.0)
    rows = tracker.problem.residuals(np.concatenate([upper, lower]))
    width = np.diag(upper - lower)
    return ((rows[: len(point)] - rows[len(point) :]) / width[:, None]).T
