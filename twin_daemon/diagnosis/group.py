"""A group of joints with the fit of what is uncertain about it, and what that leaves of its rows."""

from __future__ import annotations

import numpy as np

from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import (
    SCREENED_S,
    SHARED_NEARER,
)
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Derivative, descend, differenced
from twin_daemon.estimation.variables import Variable, over_some
from twin_daemon.estimation.windows import spread


def look(reduced: Reduced, begun: PartFit | None = None) -> tuple[Reduced, PartFit]:
    """A group with the fit of what is uncertain about it; `begun` is the group as it is at nominal values."""
    return reduced, PartFit(reduced.twin, reduced.train, reduced.joints, begun=begun)


def at_nominal(reduced: Reduced) -> tuple[Reduced, PartFit]:
    """A group with all that is uncertain about it at its nominal value."""
    return reduced, PartFit(reduced.twin, reduced.train, reduced.joints, nominal=True)


class GroupRows:
    """One group with what its nuisances can do, to first order about their nominal values."""

    def __init__(self, reduced: Reduced, part: PartFit) -> None:
        self.reduced = reduced
        self._part = part
        self._kept = spread(reduced.train, SCREENED_S)
        self._places = [next(i for i, r in enumerate(reduced.train) if r is piece) for piece in self._kept]
        problem = Posterior(reduced.twin, reduced.train, part.variables, part.joints, part.floor)
        chosen = problem.over([reduced.train[i] for i in self._places], self._variables(), ())
        rows = chosen.residuals(chosen.start[None])[0]
        slopes = differenced(chosen, chosen.start, rows, range(len(chosen.start)))
        self._basis, _ = np.linalg.qr(slopes)
        self.rows = self.left(rows)
        self.floor_cost = chosen.effective_samples
        self._problem, self._at_start, self._slopes = chosen, rows, slopes

    def above(self, floors: float) -> bool:
        """Whether the group leaves more than so many floors with what its nuisances can do.

        What is far off nominal is not taken away to first order: the nuisances are moved by some steps then.
        """
        most = floors * self.floor_cost
        if float(self.rows @ self.rows) <= most:
            return False
        moved = descend(
            self._problem,
            self._problem.start,
            Derivative(self._problem, (), self._slopes),
            evaluations=SHARED_NEARER,
            enough=lambda _, left: float(left @ left) <= most,
            begun=self._at_start,
        )
        return float(moved.rows @ moved.rows) > most

    def _variables(self) -> tuple[Variable, ...]:
        return over_some(self._part.variables, self.reduced.train, self._kept)

    def left(self, rows: np.ndarray) -> np.ndarray:
        """(m,) rows without what the nuisances can do."""
        return rows - self._basis @ (self._basis.T @ rows)

    def seen(self, changed: Reduced) -> np.ndarray:
        """(m,) what is left of the group's rows with a cause in its model."""
        pieces = [changed.train[i] for i in self._places]
        variables = self._variables()
        problem = Posterior(changed.twin, pieces, variables, self._part.joints, self._part.floor)
        return self.left(problem.residuals(problem.start[None])[0])
