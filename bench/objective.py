"""A space's error over recordings as one function, for searches that are not the product's own.

The same start, bounds, joints and roll-outs as `twin calibrate` uses: what differs is the search alone.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from twin_daemon.calibration.calibrate import judged, started
from twin_daemon.calibration.spaces import Space, objective_of, variables_of
from twin_daemon.estimation.solvers.tracker import BudgetSpent, Tracker
from twin_daemon.estimation.subproblems import reduced_problems
from twin_daemon.estimation.windows import excerpts
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.twin import TwinModel

Search = Callable[[Tracker], None]


@dataclass(frozen=True)
class Found:
    """What a search found. Errors are mean squared errors in rad^2 over the space's joints, onsets estimated anew."""

    twin: TwinModel
    before_rad2: float
    after_rad2: float
    held_rad2: float | None
    history: list[float]
    wall_s: float
    at_bound: list[str]


class Objective:
    """One space on one set of recordings. `nominal` is the twin as it was given, `twin` at the space's own start."""

    def __init__(self, twin: TwinModel, train: Sequence[Aligned], held: Sequence[Aligned], space: Space) -> None:
        moving = moving_joints(train)
        self.joints = objective_of(space, twin, moving)
        self.variables = variables_of(space, twin, moving)
        self.nominal, self.twin = twin, started(twin, space, self.variables)
        self.train, self.held = list(train), list(held)
        self.before_rad2, self.aligned = judged(self.twin, train, self.joints)

    def judged(self, twin: TwinModel) -> tuple[float, float | None]:
        """(error on the recordings that are fitted, error on those that are held out) in rad^2."""
        return judged(twin, self.train, self.joints)[0], (
            judged(twin, self.held, self.joints)[0] if self.held else None
        )

    def run(self, search: Search, budget: int | None = None) -> Found:
        """One search from the space's start; the time is that of the search alone."""
        (sub,) = reduced_problems(self.twin, excerpts(self.aligned), self.variables, self.joints, separable=False)
        tracker = Tracker(sub.problem, budget=budget)
        began = time.monotonic()
        with contextlib.suppress(BudgetSpent), threadpool_limits(limits=1):
            search(tracker)
        wall_s = time.monotonic() - began
        units = dict(zip((v.name for v in sub.problem.variables), map(float, tracker.best), strict=True))
        twin = self.twin.changed(sub.added_to(self.twin.terms, units))
        after, held = self.judged(twin)
        values = sub.problem.values(tracker.best)
        bound = [v.name for v, value in zip(sub.problem.variables, values, strict=True) if v.at_bound(float(value))]
        return Found(twin, self.before_rad2, after, held, tracker.history, wall_s, bound)


def gaussian_process(calls: int, seconds: float, seed: int) -> Search:
    """scikit-optimize's `gp_minimize` with default settings, over all dimensions, until so many calls or seconds."""

    def search(tracker: Tracker) -> None:
        from skopt import gp_minimize

        began = time.monotonic()
        gp_minimize(
            lambda point: float(tracker.cost(np.array([point]))[0]),
            [(0.0, 1.0)] * len(tracker.problem.variables),
            x0=[float(unit) for unit in tracker.problem.start],
            n_calls=calls,
            random_state=seed,
            callback=lambda _: time.monotonic() - began > seconds,
        )

    return search
