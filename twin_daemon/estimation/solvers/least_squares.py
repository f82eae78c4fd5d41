"""Bounded least squares from several starts.

One start is a trap: on a real hand starts differ by more than searches do. The starts are the model itself and
the best of a space-filling sample around it.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from twin_daemon.estimation.solvers import trust_region
from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import (
    DESCENT_ITERATIONS,
    DESCENT_NEARNESS,
    DESCENT_ROUNDS,
    DESCENT_SAMPLES,
    DESCENT_STARTS,
    FIRST_ITERATIONS,
    JACOBIAN_STEP,
    STALLED,
)


def least_squares(tracker: Tracker, budget: int | None, seed: int) -> None:
    """Some steps from each of several starts, then from the best of them to its end.

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


def descend(tracker: Tracker, start: np.ndarray, iterations: int) -> tuple[np.ndarray, float]:
    """One descent of so many steps at most: (end point (p,), its cost).

    Where it stops its derivatives may be out of date: it goes on with new ones, as long as that gains.
    """
    point, rows, cost, left = start, None, np.inf, iterations
    for _ in range(DESCENT_ROUNDS):
        derivative = trust_region.Derivative(tracker, ())
        found = trust_region.descend(tracker, point, derivative, evaluations=left, begun=rows)
        point, rows, before, cost = found.point, found.rows, cost, float(found.rows @ found.rows)
        left -= found.spent
        if left <= 0 or cost > (1.0 - STALLED) * before:
            break
    return point, cost


def jacobian(tracker: Tracker, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """(m, p) derivative of the residuals by the unit coordinates at a point (p,) whose rows (m,) are known."""
    steps = np.full(len(point), JACOBIAN_STEP)
    return trust_region.stepped(tracker, point, rows, range(len(point)), steps)
