"""Bounded least squares from several starts (`mujoco.minimize`), Jacobians by batches of roll-outs.

One start is a trap: on a real hand starts differ by more than searches do. The starts are the model itself and
the best of a space-filling sample around it.
"""

from __future__ import annotations

import contextlib

import numpy as np
from mujoco import minimize
from scipy.stats import qmc

from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import (
    DAMPING_FACTOR,
    DESCENT_ITERATIONS,
    DESCENT_NEARNESS,
    DESCENT_SAMPLES,
    DESCENT_STARTS,
    DESCENT_STEP,
    FIRST_ITERATIONS,
    JACOBIAN_STEP,
    STALLED,
    STALLED_ITERATIONS,
)


def least_squares(tracker: Tracker, budget: int | None, seed: int) -> None:
    """A rough descent from each of several starts, then the best of them to its end.

    A budget that does not even pay for a few Jacobians is spent on the model's own start.
    """
    start = tracker.problem.start
    starts = [start]
    if budget is None or budget > DESCENT_SAMPLES + DESCENT_STARTS * len(start):
        sample = qmc.Sobol(len(start), rng=seed).random(DESCENT_SAMPLES)
        # half of the sample stays near the model, which is seldom wrong by the whole box
        sample[::2] = np.clip(start + DESCENT_NEARNESS * (sample[::2] - 0.5), 0.0, 1.0)
        sample[0] = start
        costs = tracker.cost(sample)
        starts += list(sample[1:][np.argsort(costs[1:])[: DESCENT_STARTS - 1]])
    ends = [descend(tracker, point, FIRST_ITERATIONS) for point in starts]
    best, _ = min(ends, key=lambda end: end[1])
    descend(tracker, best, DESCENT_ITERATIONS)


class _Arrived(Exception):
    """The descent no longer gains."""


def descend(tracker: Tracker, start: np.ndarray, iterations: int) -> tuple[np.ndarray, float]:
    """One bounded Levenberg-Marquardt descent: (end point (p,), its cost)."""
    best = np.clip(start, 0.0, 1.0)
    best_cost = np.inf

    def residual(columns: np.ndarray) -> np.ndarray:
        nonlocal best, best_cost
        points = np.atleast_2d(columns.T)
        rows = tracker.residuals(points)
        cost = (rows**2).sum(axis=1)
        index = int(np.argmin(cost))
        if cost[index] < best_cost:
            best, best_cost = np.clip(points[index], 0.0, 1.0), float(cost[index])
        return rows.T

    def stop_when_stalled(trace: list) -> None:
        costs = [entry.objective for entry in trace[-STALLED_ITERATIONS - 1 :]]
        if len(costs) > STALLED_ITERATIONS and costs[0] - costs[-1] < STALLED * abs(costs[0]):
            raise _Arrived

    with contextlib.suppress(_Arrived):
        minimize.least_squares(
            best,
            residual,
            bounds=[np.zeros(len(start)), np.ones(len(start))],
            eps=DESCENT_STEP,
            mu_factor=DAMPING_FACTOR,
            max_iter=iterations,
            xtol=1e-5,
            gtol=1e-10,
            iter_callback=stop_when_stalled,
            verbose=minimize.Verbosity.SILENT,
        )
    return best, best_cost


def jacobian(tracker: Tracker, point: np.ndarray, step: float = JACOBIAN_STEP) -> np.ndarray:
    """(m, p) derivative of the residuals by the unit coordinates: central where the box allows, else one-sided."""
    identity = np.eye(len(point)) * step
    upper = np.clip(point + identity, 0.0, 1.0)
    lower = np.clip(point - identity, 0.0, 1.0)
    rows = tracker.residuals(np.concatenate([upper, lower]))
    width = np.diag(upper - lower)
    return ((rows[: len(point)] - rows[len(point) :]) / width[:, None]).T
