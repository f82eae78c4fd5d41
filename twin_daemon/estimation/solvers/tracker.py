"""Keeps the best point of a search while it runs, so that a search that is stopped has a result."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.variables import Variable
from twin_daemon.executor import in_pieces
from twin_daemon.processor_time import TimeLimit

Progress = Callable[[int, float], None]
"""Called after each batch with (evaluations so far, best mse in rad^2 so far)."""


class BudgetSpent(Exception):
    """The search has used all the evaluations or all the time it was given. What it found is in its tracker."""


class Tracker:
    """A problem that remembers. `history` is the best mse (rad^2) after each evaluation.

    With a `budget` the evaluation after the last one that is allowed raises BudgetSpent; with `seconds` the first
    one after them. The processor's seconds count, over the threads that roll out: a search that has to wait for
    others gets as far as one that has the machine for itself.
    """

    def __init__(
        self,
        problem: Problem,
        progress: Progress | None = None,
        budget: int | None = None,
        seconds: float | None = None,
    ) -> None:
        self.problem = problem
        self.best = problem.start
        self.best_mse = np.inf
        self._best_cost = np.inf
        self.history: list[float] = []
        self._progress = progress
        self._budget = budget
        self.limit = TimeLimit(seconds)

    @property
    def variables(self) -> tuple[Variable, ...]:
        """The problem's variables."""
        return self.problem.variables

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) residuals of points (B, p)."""
        if self.history and self.limit.over():
            raise BudgetSpent
        points = np.clip(points, 0.0, 1.0)
        left = len(points) if self._budget is None else self._budget - len(self.history)
        if left < len(points):
            if left > 0:
                self._evaluate(points[:left])
            raise BudgetSpent
        return self._evaluate(points)

    def cost(self, points: np.ndarray) -> np.ndarray:
        """(B,) mean squared error and priors' share of points (B, p)."""
        return (self.residuals(points) ** 2).sum(axis=1)

    def _evaluate(self, points: np.ndarray) -> np.ndarray:
        rows = in_pieces(self.problem.residuals, points)
        cost = (rows**2).sum(axis=1)
        mse = cost - (self.problem.prior_residuals(points) ** 2).sum(axis=1)
        for point, total, error in zip(points, cost, mse, strict=True):
            if total < self._best_cost:
                self.best, self._best_cost, self.best_mse = np.array(point), float(total), float(error)
            self.history.append(self.best_mse)
        if self._progress is not None:
            self._progress(len(self.history), self.best_mse)
        return rows
