"""What a fit is: of the nuisances alone, of a candidate beside them, and where one may begin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Descent
from twin_daemon.estimation.variables import EffectVariable, Prior


@dataclass(frozen=True)
class Fit:
    """A fitted candidate: its point over `problem.variables`, its cost (-2 log posterior) and its chi-square."""

    hypothesis: Hypothesis | None
    problem: Posterior
    point: np.ndarray
    cost: float
    chi_square: float
    slopes: np.ndarray
    """(m, p) derivative of the rows, as far as the fit knows it."""

    @property
    def values(self) -> dict[str, float]:
        """The effect's parameters by name."""
        if self.hypothesis is None:
            return {}
        key, target = self.hypothesis.effect.key, self.hypothesis.target
        started = next(t for t in self.problem.twin.terms.effects if (t.effect, t.target) == (key, target))
        found = self.hypothesis.effect.complete(started.values)
        for index, variable in self.own_variables:
            found[variable.parameter] = variable.value(self.point[index])
        return found

    @property
    def strains(self) -> dict[str, float]:
        """How many sigma each nuisance is from its prior."""
        return self.problem.strains(self.point)

    @property
    def own_variables(self) -> list[tuple[int, EffectVariable]]:
        """The effect's variables with their place in the point."""
        every = enumerate(self.problem.variables)
        return [(i, v) for i, v in every if isinstance(v, EffectVariable) and self._is_own(v)]

    def _is_own(self, variable: EffectVariable) -> bool:
        own = self.hypothesis
        return own is not None and (variable.effect, variable.target) == (own.effect.key, own.target)

    @property
    def nuisances(self) -> dict[str, float]:
        """Unit coordinates of the nuisances by name."""
        return {
            v.name: float(u) for v, u in zip(self.problem.variables, self.point, strict=True) if v.prior is not None
        }

    def uncertain_values(self) -> list[EffectVariable]:
        """The effect's parameters as nuisances: a value that was found while something else was missing is off."""
        assert self.hypothesis is not None
        neutral, out = self.hypothesis.effect.neutral(), []
        for index, variable in self.own_variables:
            value = variable.value(self.point[index])
            mean = variable.low + self.point[index] * (variable.high - variable.low)
            away = 1.0 if variable.log else abs(value - neutral[variable.parameter])
            sigma = max(_SHARE * away, _LEAST_SHARE * (variable.high - variable.low))
            out.append(replace(variable, start=value, along=(), prior=Prior(float(mean), sigma)))
        return out


_SHARE = 0.5  # of an effect's strength: its sigma beside what is still to be found
_LEAST_SHARE = 0.01  # of its box


def as_fit(hypothesis: Hypothesis | None, problem: Posterior, found: Descent) -> Fit:
    """A descent's end as a fit."""
    cost = float(found.rows @ found.rows)
    priors = problem.prior_residuals(found.point[None])[0]
    chi_square = (cost - float(priors @ priors)) / problem.effective_samples
    return Fit(hypothesis, problem, found.point, cost, chi_square, found.slopes)


@dataclass(frozen=True)
class Start:
    """Where a fit of a candidate may begin: its values, the nuisances' point, and the cost expected of it."""

    hypothesis: Hypothesis
    values: dict[str, float]
    anchor: frozenset[str] | None
    expected: float


@dataclass(frozen=True)
class Rough:
    """A candidate's point and cost on the motion that is screened, and its problem over all motion."""

    start: Start
    problem: Posterior
    point: np.ndarray
    cost: float

    @property
    def hypothesis(self) -> Hypothesis:
        return self.start.hypothesis


def own_columns(problem: Posterior) -> list[int]:
    """Where the variables of effects are: those without a prior."""
    return [i for i, variable in enumerate(problem.variables) if variable.prior is None]
