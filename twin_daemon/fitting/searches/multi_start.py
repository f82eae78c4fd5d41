"""Least squares from many starts around the model as it is: for models whose cost has many hollows.

Dry friction, stops and preloads make corners at which a descent stalls: on a real finger, ends of single descents
differ by a factor of three in the error they leave.
"""

from __future__ import annotations

import numpy as np

from twin_daemon.fitting.knobs import Knob
from twin_daemon.fitting.searches.least_squares import descend
from twin_daemon.fitting.tracker import Tracker

_SAMPLES = 300
_STARTS = 12
_ROUGH_ITERATIONS = 10
_FINISHED = 3
_ITERATIONS = 60
_SPREAD = 0.7  # standard deviation of a value's logarithm: about a factor of two either way
_SIGNED = 0.02  # of the box: standard deviation of a value that is 0 or may change its sign


def multi_start(tracker: Tracker, budget: int | None, seed: int) -> None:
    """Descends roughly from the best of a sample around the start, and from the best ends to the end."""
    problem, rng = tracker.problem, np.random.default_rng(seed)
    samples = _SAMPLES if budget is None else min(_SAMPLES, budget // 4)
    spread = rng.standard_normal((samples, len(problem.knobs)))
    sample = np.array([[_near(k, z) for k, z in zip(problem.knobs, row, strict=True)] for row in spread])
    points = np.concatenate([problem.start[None], sample])
    order = np.argsort(tracker.cost(points), kind="stable")
    ends = [descend(tracker, points[i], _ROUGH_ITERATIONS) for i in order[:_STARTS]]
    for point, _ in sorted(ends, key=lambda end: end[1])[:_FINISHED]:
        descend(tracker, point, _ITERATIONS)


def _near(knob: Knob, z: float) -> float:
    """The unit coordinate of a value `z` standard deviations from the knob's start."""
    if knob.start == 0.0 or knob.lower < 0.0:
        value = knob.start + z * _SIGNED * (knob.upper - knob.lower)
    else:
        value = knob.start * np.exp(_SPREAD * z)
    return knob.coordinate(float(min(max(value, knob.lower), knob.upper)))
