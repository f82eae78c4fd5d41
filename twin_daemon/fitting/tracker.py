"""Keeps the best point of a search while it runs, so that an interrupted search has a result."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from twin_daemon.fitting.problem import Problem

Progress = Callable[[int, float], None]
"""Called after each batch with (evaluations so far, best mse in rad^2 so far)."""


class Tracker:
    """A problem that remembers. `history` is the best mse (rad^2) after each evaluation."""

    def __init__(self, problem: Problem, progress: Progress | None = None) -> None:
        self.problem = problem
        self.best = problem.start
        self.best_mse = np.inf
        self._best_cost = np.inf
        self.history: list[float] = []
        self._progress = progress

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) residuals of points (B, p)."""
        points = np.clip(points, 0.0, 1.0)
        rows = self.problem.residuals(points)
        priors = self.problem.prior_residuals(points)
        cost = (rows**2).sum(axis=1)
        self._note(points, cost, cost - (priors**2).sum(axis=1))
        return rows

    def cost(self, points: np.ndarray) -> np.ndarray:
        """(B,) mean squared error and priors' share of points (B, p)."""
        return (self.residuals(points) ** 2).sum(axis=1)

    def _note(self, points: np.ndarray, cost: np.ndarray, mse: np.ndarray) -> None:
        for point, total, error in zip(points, cost, mse, strict=True):
            if total < self._best_cost:
                self.best, self._best_cost, self.best_mse = np.array(point), float(total), float(error)
            self.history.append(self.best_mse)
        if self._progress is not None:
            self._progress(len(self.history), self.best_mse)
