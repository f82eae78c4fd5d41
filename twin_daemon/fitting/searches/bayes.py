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
_CALLS = 60
_POLISH_ITERATIONS = 8


def bayes(tracker: Tracker, budget: int | None, seed: int) -> None:
    """The Gaussian process asks 60 times, or, where that is less, for half of what the screening leaves."""
    look_round(tracker, budget, seed)
    descend(tracker, tracker.best, _POLISH_ITERATIONS)


def look_round(tracker: Tracker, budget: int | None, seed: int, share: float = 1.0) -> None:
    """The screening and the Gaussian process, which asks no more once this share of the tracker's time has gone."""
    from skopt import Optimizer  # imports scikit-learn, which takes a second

    start = tracker.problem.start
    first_cost = float(tracker.cost(start[None])[0])
    chosen = np.arange(len(start))
    screening = 2 * len(start)
    if len(start) > _DIMENSIONS and (budget is None or budget > 2 * screening):
        strength = np.linalg.norm(jacobian(tracker, start), axis=0)
        chosen = np.sort(np.argsort(strength)[::-1][:_DIMENSIONS])
    calls = _CALLS if budget is None else min(_CALLS, max((budget - len(tracker.history)) // 2, 4))
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
