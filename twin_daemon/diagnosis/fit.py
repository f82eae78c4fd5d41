"""What a fit is: of the nuisances alone, of a candidate beside them, and where one may begin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.descent import Descent
from twin_daemon.diagnosis.whitened import WhitenedProblem
from twin_daemon.fitting.knobs import Knob, Prior


@dataclass(frozen=True)
class Fit:
    """A fitted candidate: its point over `problem.knobs`, its cost (-2 log posterior) and its chi-square."""

    hypothesis: Hypothesis | None
    problem: WhitenedProblem
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
        for index, knob in self.own_knobs:
            found[knob.name.rpartition(".")[2]] = knob.value(self.point[index])
        return found

    @property
    def strains(self) -> dict[str, float]:
        """How many sigma each nuisance is from its prior."""
        return self.problem.strains(self.point)

    @property
    def own_knobs(self) -> list[tuple[int, Knob]]:
        """The effect's knobs with their place in the point."""
        name = self.hypothesis.name if self.hypothesis else None
        return [(i, k) for i, k in enumerate(self.problem.knobs) if k.name.rpartition(".")[0] == name]

    @property
    def nuisances(self) -> dict[str, float]:
        """Unit coordinates of the nuisances by name."""
        return {k.name: float(u) for k, u in zip(self.problem.knobs, self.point, strict=True) if k.prior is not None}

    def uncertain_values(self) -> list[Knob]:
        """The effect's parameters as nuisances: a value that was found while something else was missing is off."""
        assert self.hypothesis is not None
        neutral, out = self.hypothesis.effect.neutral(), []
        for index, knob in self.own_knobs:
            value = knob.value(self.point[index])
            mean = knob.low + self.point[index] * (knob.high - knob.low)
            away = 1.0 if knob.log else abs(value - neutral[knob.name.rpartition(".")[2]])
            sigma = max(_SHARE * away, _LEAST_SHARE * (knob.high - knob.low))
            own = tuple(write for write in knob.writes if write[0] == "effect")
            out.append(replace(knob, start=value, mode="set", writes=own, prior=Prior(float(mean), sigma)))
        return out


_SHARE = 0.5  # of an effect's strength: its sigma beside what is still to be found
_LEAST_SHARE = 0.01  # of its box


def as_fit(hypothesis: Hypothesis | None, problem: WhitenedProblem, found: Descent) -> Fit:
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
    problem: WhitenedProblem
    point: np.ndarray
    cost: float

    @property
    def hypothesis(self) -> Hypothesis:
        return self.start.hypothesis


def own_columns(problem: WhitenedProblem) -> list[int]:
    """Where the knobs of effects are: those without a prior."""
    return [i for i, knob in enumerate(problem.knobs) if knob.prior is None]
