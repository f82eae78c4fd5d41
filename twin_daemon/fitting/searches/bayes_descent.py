"""A Bayesian search in the dimensions that matter, then least squares over all of them, to the end.

For a model that was right and has drifted: each part of the hand is looked round where its values show most, and
descends from the best of that.
"""

from __future__ import annotations

from twin_daemon.fitting.searches.bayes import look_round
from twin_daemon.fitting.searches.least_squares import descend
from twin_daemon.fitting.tracker import Tracker

_LOOKING = 0.4  # of the time
_ITERATIONS = 40


def bayes_descent(tracker: Tracker, budget: int | None, seed: int) -> None:
    """The Gaussian process has two fifths of the time, if there is a limit to it."""
    look_round(tracker, budget, seed, _LOOKING)
    descend(tracker, tracker.best, _ITERATIONS)
