"""The search of a calibration's sub-problems: side by side where there are cores, else one after another.

From outside they are one search with one falling error, that tells how far it has come and can be interrupted.
"""

from __future__ import annotations

import contextlib
import mmap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.solvers import Search
from twin_daemon.estimation.solvers.tracker import BudgetSpent, Progress, Tracker
from twin_daemon.estimation.subproblems import SubProblem
from twin_daemon.estimation.windows import length_s
from twin_daemon.executor import places, side_by_side
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit


@dataclass(frozen=True)
class _Found:
    """What the search of one problem has come to: its best point (p,), the error there and after each evaluation."""

    best: np.ndarray
    mse: float
    history: list[float]

    @classmethod
    def of(cls, tracker: Tracker) -> _Found:
        return cls(tracker.best, tracker.best_mse, tracker.history)


class _Shared:
    """What a search in a process of its own has come to so far, in memory that it shares with the one that forked it.

    Written is one of two places in turn and then which: what a process that is killed has half written is not read.
    """

    def __init__(self, width: int) -> None:
        self._which = np.frombuffer(mmap.mmap(-1, mmap.PAGESIZE), dtype=np.int64)
        size = 2 * (2 + width) * np.dtype(np.float64).itemsize
        self._rows = np.frombuffer(mmap.mmap(-1, size), dtype=np.float64).reshape(2, -1)

    def write(self, tracker: Tracker) -> None:
        other = 1 - int(self._which[0])
        self._rows[other] = [len(tracker.history), tracker.best_mse, *tracker.best]
        self._which[0] = other

    @property
    def count(self) -> int:
        """Evaluations so far."""
        return int(self._rows[self._which[0], 0])

    @property
    def mse(self) -> float:
        """The best error so far (rad^2); 0 before there is one."""
        return float(self._rows[self._which[0], 1])

    def found(self) -> _Found:
        """The best point so far. Of the errors on the way there the last alone is known."""
        return _Found(self._rows[self._which[0], 2:].copy(), self.mse, [self.mse] * self.count)


class PartwiseSearch:
    """What searches over sub-problems have found so far.

    `units` is the best unit coordinate of each variable by name, `history` the best mse (rad^2) of the whole
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

        They run side by side unless a time is shared out. A KeyboardInterrupt passes through, once the best points so
        far are kept.
        """
        errors = [float(sub.problem.mse(sub.start(self.units)[None])[0]) * sub.weight for sub in problems]
        share = None if budget is None else max(1, budget // len(problems))
        if seconds is None and places(len(problems)) > 1:
            self._run_side_by_side(problems, search, share, seed, errors)
            return
        time_share = None if seconds is None else seconds / len(problems)
        limit = TimeLimit(seconds)
        for index, sub in enumerate(problems):
            if index and limit.over():
                break  # what is left stays as it is known
            others = sum(errors) - errors[index]
            tracker = Tracker(sub.restarted(self.units), self._reporter(sub.weight, others), share, time_share)
            try:
                _search(tracker, search, share, seed)
            finally:
                self._keep(sub, _Found.of(tracker), others)
            errors[index] = min(errors[index], tracker.best_mse * sub.weight)

    def _run_side_by_side(
        self, problems: Sequence[SubProblem], search: Search, budget: int | None, seed: int, errors: list[float]
    ) -> None:
        """Searches each sub-problem in a process of its own."""
        shared = [_Shared(len(sub.problem.variables)) for sub in problems]

        def searched(index: int, _: Say) -> _Found:
            tracker = Tracker(problems[index].restarted(self.units), lambda *_: shared[index].write(tracker), budget)
            _search(tracker, search, budget, seed)
            return _Found.of(tracker)

        begun = len(self.history)

        def tell() -> None:
            count = sum(one.count for one in shared)
            if self._progress is not None and count:
                known = zip(problems, shared, errors, strict=True)
                best = sum(min(error, one.mse * sub.weight) if one.count else error for sub, one, error in known)
                self._progress(begun + count, best)

        found: dict[int, _Found] = {}
        longest_first = sorted(range(len(problems)), key=lambda index: -_work(problems[index].problem))
        try:
            for place, one in side_by_side(searched, longest_first, lambda _: None, meanwhile=tell):
                found[longest_first[place]] = one
        finally:
            for index, sub in enumerate(problems):
                one = found.get(index) or shared[index].found()
                self._keep(sub, one, sum(errors) - errors[index])
                if one.history:
                    errors[index] = min(errors[index], one.mse * sub.weight)

    def _keep(self, sub: SubProblem, found: _Found, others: float) -> None:
        if not found.history:
            return
        names = [variable.name for variable in sub.problem.variables]
        self.units.update(zip(names, map(float, found.best), strict=True))
        whole = [*self.history[-1:], *(mse * sub.weight + others for mse in found.history)]
        self.history.extend(np.minimum.accumulate(whole)[len(self.history[-1:]) :].tolist())

    def _reporter(self, weight: float, others: float) -> Progress | None:
        progress, before = self._progress, len(self.history)
        if progress is None:
            return None
        return lambda count, mse: progress(before + count, mse * weight + others)


def _work(problem: Problem) -> float:
    """How long a search of a problem takes beside others: roll-outs of its motion, as many as it has variables."""
    return len(problem.variables) * length_s(problem.recordings)


def _search(tracker: Tracker, search: Search, budget: int | None, seed: int) -> None:
    # the searches' matrices are small: threads of a matrix product would mostly wait for each other
    with contextlib.suppress(BudgetSpent), threadpool_limits(limits=1):
        search(tracker, budget, seed)
