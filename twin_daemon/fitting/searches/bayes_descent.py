"""A Bayesian search in the dimensions that matter, then least squares over all of them, to the end.

For a model that was right and has drifted: each part of the hand is looked round where its values show most. The best
of that may lie in another hollow than the values do that the model had, so both are descended from.
"""

from __future__ import annotations

from twin_daemon.fitting.searches.bayes import look_round
from twin_daemon.fitting.searches.least_squares import descend
from twin_daemon.fitting.tracker import Tracker

_LOOKING = 0.4  # of the time
_ROUGH_ITERATIONS = 8
_ITERATIONS = 40


def bayes_descent(tracker: Tracker, budget: int | None, seed: int) -> None:
    """The Gaussian process has two fifths of the time, if there is a limit to it."""
    start = tracker.problem.start
    known = descend(tracker, start, _ROUGH_ITERATIONS)
    look_round(tracker, budget, seed, _LOOKING)
    found = descend(tracker, tracker.best, _ROUGH_ITERATIONS)
    best, _ = min(known, found, key=lambda end: end[1])
    descend(tracker, best, _ITERATIONS)
