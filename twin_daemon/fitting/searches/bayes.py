"""Bayesian search (scikit-optimize) over the few knobs that matter, polished by least squares.

A Gaussian process costs seconds a call in twenty dimensions and learns little there. So the knobs are screened
by their sensitivity at the start; the search runs over the strongest, and a bounded least squares over all of
them finishes what it has found.
"""

from __future__ import annotations

import warnings

import numpy as np

from twin_daemon.fitting.searches.least_squares import descend, jacobian
from twin_daemon.fitting.tracker import Tracker

_DIMENSIONS = 6
_POLISH_ITERATIONS = 8


def bayes(tracker: Tracker, budget: int | None, seed: int) -> None:
    """`budget` calls of the Gaussian process search (60 by default), then the polish."""
    from skopt import Optimizer  # imports scikit-learn, which takes a second

    problem = tracker.problem
    start = problem.start
    strength = np.linalg.norm(jacobian(tracker, start), axis=0)
    chosen = np.sort(np.argsort(strength)[::-1][:_DIMENSIONS])
    calls = 60 if budget is None else max(budget - len(problem.knobs) - 1, 4)
    optimizer = Optimizer(
        [(0.0, 1.0)] * len(chosen),
        base_estimator="GP",
        n_initial_points=min(10, max(2, calls // 3)),
        initial_point_generator="sobol",
        random_state=seed,
    )
    first_cost = float(tracker.cost(start[None])[0])
    with warnings.catch_warnings():
        # the Gaussian process warns when a point comes up twice or a length scale meets its bound
        warnings.simplefilter("ignore")
        optimizer.tell([float(v) for v in start[chosen]], np.log(first_cost))
        for _ in range(calls):
            asked = optimizer.ask()
            point = start.copy()
            point[chosen] = asked
            optimizer.tell(asked, float(np.log(max(tracker.cost(point[None])[0], 1e-12))))
    descend(tracker, tracker.best, _POLISH_ITERATIONS)
