"""Random search, as the dissertation ran it: independent uniform points in the box."""

from __future__ import annotations

import numpy as np

from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import RANDOM_BATCH


def random_search(tracker: Tracker, budget: int | None, seed: int) -> None:
    """`budget` points (1000 by default), the start first."""
    rng = np.random.default_rng(seed)
    budget = 1000 if budget is None else budget
    for first in range(0, budget, RANDOM_BATCH):
        points = rng.random((min(RANDOM_BATCH, budget - first), len(tracker.problem.variables)))
        if first == 0:
            points[0] = tracker.problem.start
        tracker.cost(points)
