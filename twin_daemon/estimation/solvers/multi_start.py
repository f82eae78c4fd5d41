"""Least squares from many starts around the model as it is: for models whose cost has many hollows.

Dry friction, stops and preloads make corners at which a descent stalls: on a real finger, ends of single descents
differ by a factor of three in the error they leave.
"""

from __future__ import annotations

import numpy as np

from twin_daemon.estimation.solvers.least_squares import descend
from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import (
    MULTI_FINISHED,
    MULTI_FIRST_ITERATIONS,
    MULTI_ITERATIONS,
    MULTI_SAMPLES,
    MULTI_SIGNED_SHARE,
    MULTI_SPREAD,
    MULTI_STARTS,
)
from twin_daemon.estimation.variables import Variable


def multi_start(tracker: Tracker, budget: int | None, seed: int) -> None:
    """Descends some way from the best of a sample around the start, and from the best ends to the end."""
    problem, rng = tracker.problem, np.random.default_rng(seed)
    samples = MULTI_SAMPLES if budget is None else min(MULTI_SAMPLES, budget // 4)
    spread = rng.standard_normal((samples, len(problem.variables)))
    sample = np.array([[_near(k, z) for k, z in zip(problem.variables, row, strict=True)] for row in spread])
    points = np.concatenate([problem.start[None], sample])
    order = np.argsort(tracker.cost(points), kind="stable")
    ends = [descend(tracker, points[i], MULTI_FIRST_ITERATIONS) for i in order[:MULTI_STARTS]]
    for point, _ in sorted(ends, key=lambda end: end[1])[:MULTI_FINISHED]:
        descend(tracker, point, MULTI_ITERATIONS)


def _near(variable: Variable, z: float) -> float:
    """The unit coordinate of a value `z` standard deviations from the variable's start."""
    if variable.start == 0.0 or variable.lower < 0.0:
        value = variable.start + z * MULTI_SIGNED_SHARE * (variable.upper - variable.lower)
    else:
        value = variable.start * np.exp(MULTI_SPREAD * z)
    return variable.coordinate(float(min(max(value, variable.lower), variable.upper)))
