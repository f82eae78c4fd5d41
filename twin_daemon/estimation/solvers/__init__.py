"""The searches by name. Each is one function of a tracked problem; the tracker keeps the best point."""

from __future__ import annotations

from typing import Protocol

from twin_daemon.estimation.solvers.bayes import bayes, bayes_descent
from twin_daemon.estimation.solvers.least_squares import least_squares
from twin_daemon.estimation.solvers.multi_start import multi_start
from twin_daemon.estimation.solvers.pso import pso
from twin_daemon.estimation.solvers.random import random_search
from twin_daemon.estimation.solvers.tracker import Tracker


class Search(Protocol):
    """Lowers the tracked problem's cost with about `budget` evaluations, reproducibly for a seed."""

    def __call__(self, tracker: Tracker, budget: int | None, seed: int) -> None: ...


SEARCHES: dict[str, Search] = {
    "least-squares": least_squares,
    "multi-start": multi_start,
    "bayes": bayes,
    "bayes-descent": bayes_descent,
    "pso": pso,
    "random": random_search,
}

DESCENTS = ("least-squares", "multi-start", "bayes-descent")
"""Searches that take the parts of a hand one after another, and are polished where an onset moved meanwhile."""
