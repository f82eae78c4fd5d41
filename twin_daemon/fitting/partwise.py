"""Searches the parts of a hand one after another; from outside it is one search with one falling error."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from twin_daemon.fitting.reduce import SubProblem
from twin_daemon.fitting.searches import Search
from twin_daemon.fitting.tracker import BudgetSpent, Progress, Tracker


class PartwiseSearch:
    """What searches over sub-problems have found so far.

    `units` is the best unit coordinate of each knob by name, `history` the best mse (rad^2) of the whole
    objective after each evaluation.
    """

    def __init__(self, progress: Progress | None = None) -> None:
        self.units: dict[str, float] = {}
        self.history: list[float] = []
        self._progress = progress

    def run(
        self,
        problems: Sequence[SubProblem],
        search: Search,
        budget: int | None,
        seed: int,
        seconds: float | None = None,
    ) -> None:
        """Searches each sub-problem from what is known already, with its share of the budget and of the time.

        A KeyboardInterrupt passes through, once the best point so far is kept.
        """
        share = None if budget is None else max(1, budget // len(problems))
        time_share = None if seconds is None else seconds / len(problems)
        errors = [float(sub.problem.mse(sub.start(self.units)[None])[0]) * sub.weight for sub in problems]
        for index, sub in enumerate(problems):
            others = sum(errors) - errors[index]
            tracker = Tracker(sub.restarted(self.units), self._reporter(sub.weight, others), share, time_share)
            try:
                # the searches' matrices are small: threads of a matrix product would mostly wait for each other
                with contextlib.suppress(BudgetSpent), threadpool_limits(limits=1):
                    search(tracker, share, seed)
            finally:
                self._keep(sub, tracker, others)
            errors[index] = min(errors[index], tracker.best_mse * sub.weight)

    def _keep(self, sub: SubProblem, tracker: Tracker, others: float) -> None:
        if not tracker.history:
            return
        names = [knob.name for knob in sub.problem.knobs]
        self.units.update(zip(names, map(float, tracker.best), strict=True))
        whole = [*self.history[-1:], *(mse * sub.weight + others for mse in tracker.history)]
        self.history.extend(np.minimum.accumulate(whole)[len(self.history[-1:]) :].tolist())

    def _reporter(self, weight: float, others: float) -> Progress | None:
        progress, before = self._progress, len(self.history)
        if progress is None:
            return None
        return lambda count, mse: progress(before + count, mse * weight + others)
