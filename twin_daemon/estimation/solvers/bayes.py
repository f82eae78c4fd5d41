"""Bayesian search (scikit-optimize) over the few variables that matter, polished by least squares.

A Gaussian process costs seconds a call in twenty dimensions and learns little there. So the variables are screened
by their sensitivity at the start; the search runs over the strongest, and a bounded least squares over all of
them finishes what it has found.
"""

from __future__ import annotations

import warnings

import numpy as np

from twin_daemon.estimation.solvers.least_squares import descend, jacobian
from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import (
    BAYES_CALLS,
    BAYES_DESCENT_FIRST_ITERATIONS,
    BAYES_DESCENT_ITERATIONS,
    BAYES_DIMENSIONS,
    BAYES_POLISH_ITERATIONS,
    BAYES_TIME_SHARE,
)


def bayes(tracker: Tracker, budget: int | None, seed: int) -> None:
    """The Gaussian process asks 60 times, or, where that is less, for half of what the screening leaves."""
    look_round(tracker, budget, seed)
    descend(tracker, tracker.best, BAYES_POLISH_ITERATIONS)


def look_round(tracker: Tracker, budget: int | None, seed: int, share: float = 1.0) -> None:
    """The screening and the Gaussian process, which asks no more once this share of the tracker's time has gone."""
    from skopt import Optimizer  # imports scikit-learn, which takes a second

    start = tracker.problem.start
    rows = tracker.residuals(start[None])[0]
    first_cost = float((rows**2).sum())
    chosen = np.arange(len(start))
    screening = len(start)
    if len(start) > BAYES_DIMENSIONS and (budget is None or budget > 2 * screening):
        strength = np.linalg.norm(jacobian(tracker, start, rows), axis=0)
        chosen = np.sort(np.argsort(strength)[::-1][:BAYES_DIMENSIONS])
    calls = BAYES_CALLS if budget is None else min(BAYES_CALLS, max((budget - len(tracker.history)) // 2, 4))
    optimizer = Optimizer(
        [(0.0, 1.0)] * len(chosen),
        base_estimator="GP",
        n_initial_points=8 if calls >= 16 else 2,  # a power of 2, as a Sobol sequence wants it
        initial_point_generator="sobol",
        random_state=seed,
    )
    with warnings.catch_warnings():
        # the Gaussian process warns when a point comes up twice or a length scale meets its bound
        warnings.simplefilter("ignore")
        optimizer.tell([float(v) for v in start[chosen]], float(np.log(max(first_cost, 1e-12))))
        for _ in range(calls):
            if tracker.limit.over(share):
                break
            asked = optimizer.ask()
            point = start.copy()
            point[chosen] = asked
            optimizer.tell(asked, float(np.log(max(tracker.cost(point[None])[0], 1e-12))))


def bayes_descent(tracker: Tracker, budget: int | None, seed: int) -> None:
    """The Gaussian process has two fifths of the time, if there is a limit to it."""
    start = tracker.problem.start
    known = descend(tracker, start, BAYES_DESCENT_FIRST_ITERATIONS)
    look_round(tracker, budget, seed, BAYES_TIME_SHARE)
    found = descend(tracker, tracker.best, BAYES_DESCENT_FIRST_ITERATIONS)
    best, _ = min(known, found, key=lambda end: end[1])
    descend(tracker, best, BAYES_DESCENT_ITERATIONS)
