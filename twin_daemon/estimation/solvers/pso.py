"""Particle swarm (Kennedy and Eberhart 1995) with the dissertation's settings: 10 particles, 100 iterations."""

from __future__ import annotations

import numpy as np

from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import (
    SWARM_INERTIA,
    SWARM_LEADER,
    SWARM_OWN,
    SWARM_PARTICLES,
)


def pso(tracker: Tracker, budget: int | None, seed: int) -> None:
    """`budget` evaluations (1000 by default) in whole iterations; a particle that leaves the box stops at its wall."""
    rng = np.random.default_rng(seed)
    iterations = max(1, (1000 if budget is None else budget) // SWARM_PARTICLES)
    dimensions = len(tracker.problem.variables)
    position = rng.random((SWARM_PARTICLES, dimensions))
    position[0] = tracker.problem.start
    velocity = np.zeros_like(position)
    best, best_cost = position.copy(), np.full(SWARM_PARTICLES, np.inf)
    for _ in range(iterations):
        cost = tracker.cost(position)
        better = cost < best_cost
        best[better], best_cost[better] = position[better], cost[better]
        leader = best[int(np.argmin(best_cost))]
        own, swarm = rng.random((2, SWARM_PARTICLES, dimensions))
        pulled = SWARM_INERTIA * velocity + SWARM_OWN * own * (best - position)
        velocity = pulled + SWARM_LEADER * swarm * (leader - position)
        position = np.clip(position + velocity, 0.0, 1.0)
