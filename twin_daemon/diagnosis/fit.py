"""What a fit is: of nuisances alone, of a candidate beside them, where one may begin, and how sure its values are."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.in_turn import without_each
from twin_daemon.diagnosis.thresholds import (
    DECISIVE_NATS,
    DEVIATING_SIGMA,
    FOUND_LEAST_SHARE,
    FOUND_SHARE,
    NEXT_TO_NOTHING,
    SPOKEN_SIGMA,
)
from twin_daemon.diagnosis.verdict import MovedParameter
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Descent
from twin_daemon.estimation.thresholds import BOX_INFORMATION, Z95
from twin_daemon.estimation.uncertainty import Estimate, estimated, inflation, unit_covariance, widened
from twin_daemon.estimation.variables import EffectVariable, ParameterVariable, Prior
from twin_daemon.simulation.twin import TwinModel


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
    def name(self) -> str:
        """The candidate's; none where the nuisances alone were fitted."""
        return self.hypothesis.name if self.hypothesis else ""

    @property
    def prior_cost(self) -> float:
        """What of the cost is said by the priors of uncertain values, not by the data."""
        priors = self.problem.prior_residuals(self.point[None])[0]
        return float(priors @ priors)

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
    def moved(self) -> dict[str, float]:
        """The model's own parameters where the fit has taken them: absolute, by name."""
        return self.problem.settings(self.point)[0]

    @cached_property
    def deviations(self) -> dict[str, float]:
        """How many sigma each nuisance is from its prior, the zeros of readings ("<joint>.offset") among them."""
        offsets = {f"{joint}.offset": sigma for joint, sigma in self.problem.offsets(self.point).items()}
        return self.problem.deviations(self.point) | offsets

    @property
    def own_variables(self) -> list[tuple[int, EffectVariable]]:
        """The effect's variables with their place in the point."""
        every = enumerate(self.problem.variables)
        return [(i, v) for i, v in every if isinstance(v, EffectVariable) and self._is_own(v)]

    def _is_own(self, variable: EffectVariable) -> bool:
        own = self.hypothesis
        return own is not None and (variable.effect, variable.target) == (own.effect.key, own.target)

    @cached_property
    def by_others(self) -> dict[str, Fit]:
        """The fit as it is without one recording of those that it is on, by the recording (`in_turn.motion_of`)."""
        found = without_each(self.problem, self.point, self.slopes, max(1.0, self.chi_square))
        return {motion: replace(self, point=point, slopes=slopes) for motion, (point, slopes) in found.items()}

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
            sigma = max(FOUND_SHARE * away, FOUND_LEAST_SHARE * (variable.high - variable.low))
            out.append(replace(variable, start=value, along=(), prior=Prior(float(mean), sigma)))
        return out


def as_fit(hypothesis: Hypothesis | None, problem: Posterior, found: Descent) -> Fit:
    """A descent's end as a fit."""
    left = float(found.rows @ found.rows)
    priors = problem.prior_residuals(found.point[None])[0]
    chi_square = (left - float(priors @ priors)) / problem.effective_samples
    return Fit(hypothesis, problem, found.point, left + problem.uncertainty_cost, chi_square, found.slopes)


@dataclass(frozen=True)
class Start:
    """Where a fit of a candidate may begin: its values, the nuisances' point, and the cost expected of it.

    `nuisances` are the unit coordinates of those that are known beside it, by name, whatever the point says of them.
    """

    hypothesis: Hypothesis
    values: dict[str, float]
    anchor: frozenset[str] | None
    expected: float
    nuisances: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class FirstFit:
    """A candidate's point and cost on the motion that is screened, and its problem over all motion.

    `rows` (m,) and `slopes` (m, p) are those at the point, so that a fit goes on from there. One that has only been
    begun keeps no slopes, as they follow from its start: of a large arm they are some 20 MB for each of a hundred.
    """

    start: Start
    problem: Posterior
    point: np.ndarray
    cost: float
    rows: np.ndarray
    slopes: np.ndarray | None = None

    @property
    def hypothesis(self) -> Hypothesis:
        return self.start.hypothesis

    @property
    def prior_cost(self) -> float:
        """As of a fit: the priors' rows are the last ones."""
        priors = self.rows[len(self.rows) - len(self.problem.prior_slopes()) :]
        return float(priors @ priors)


def own_columns(problem: Posterior) -> list[int]:
    """Where the variables of effects are: those without a prior."""
    return [i for i, variable in enumerate(problem.variables) if variable.prior is None]


def value_interval(fit: Fit, index: int, variable: EffectVariable, sigma: float) -> tuple[float, float]:
    """95 % interval of an effect's value from the sigma of its unit coordinate.

    An effect that speaks for a nominal parameter is known no better than the nominal parameter is.
    """
    weighed = weighed_share(fit.problem.twin, variable.unit) * abs(variable.value(fit.point[index]))
    return widened(variable, fit.point[index], sigma, Z95 * max(weighed, _nominal_sigma(fit, variable)))


def weighed_share(twin: TwinModel, unit: str) -> float:
    """One sigma, as a share of a value in this unit, of what positions tell only beside the links' own weight.

    A torque is seen as a part of the servo's stiffness, and how large that is only gravity and inertia tell: of a link
    the mass and the centre of mass are each known to so much.
    """
    weighed = "N m" in unit or "kg" in unit
    return float(np.sqrt(2.0) * twin.hand.description.nominal_uncertainty.mass) if weighed else 0.0


def stands_out(fit: Fit) -> bool:
    """Whether an effect does anything, and if the model has it already, whether its 95 % interval leaves that out.

    A thousandth of a delay may fit as well as all of it: what is gained is then the form's in which it is computed.
    """
    if fit.hypothesis is None:
        return True
    effect, neutral = fit.hypothesis.effect, fit.hypothesis.effect.neutral()
    values = fit.values
    if all(values[name] == neutral[name] for name in effect.presence):
        return False  # what is gained beside it is its nuisances' own
    if _leave_neutral(fit, effect.presence):
        return True
    return not fit.hypothesis.speaks_for(fit.problem.twin) and not _does_as_well_without(fit)


def _does_as_well_without(fit: Fit) -> bool:
    """Whether a thousandth of what makes the effect present fits as well, everything else as it is."""
    assert fit.hypothesis is not None
    neutral, point = fit.hypothesis.effect.neutral(), fit.point.copy()
    for index, variable in fit.own_variables:
        if variable.parameter in fit.hypothesis.effect.presence:
            nothing = variable.coordinate(neutral[variable.parameter])
            point[index] = nothing + NEXT_TO_NOTHING * (point[index] - nothing)
    rows = fit.problem.residuals(point[None])[0]
    return float(rows @ rows) + fit.problem.uncertainty_cost - fit.cost < 2.0 * DECISIVE_NATS


def is_idle(fit: Fit) -> bool:
    """Whether the parameter that a law is about may as well do nothing, such as the stiffness of a spring."""
    assert fit.hypothesis is not None
    return not _leave_neutral(fit, (fit.hypothesis.effect.parameters[0].name,))


def _leave_neutral(fit: Fit, names: Collection[str]) -> bool:
    """Whether the 95 % interval of any of these parameters leaves its neutral value out."""
    assert fit.hypothesis is not None
    sigmas, neutral = own_sigmas(fit), fit.hypothesis.effect.neutral()
    for index, variable in fit.own_variables:
        low, high = value_interval(fit, index, variable, sigmas[index])
        if variable.parameter in names and not low <= neutral[variable.parameter] <= high:
            return True
    return False


def _nominal_sigma(fit: Fit, variable: EffectVariable) -> float:
    """What the nominal parameter's own uncertainty adds to an effect's, in the variable's unit."""
    hypothesis, twin = fit.hypothesis, fit.problem.twin
    if hypothesis is None or (variable.effect, variable.target, variable.parameter) != (
        hypothesis.effect.key,
        hypothesis.target,
        hypothesis.effect.parameters[0].name,
    ):
        return 0.0
    spoken = hypothesis.speaks_for(twin)
    if not spoken:
        return 0.0
    sigma = twin.hand.description.nominal_uncertainty.of(next(iter(spoken)))
    if hypothesis.effect.parameters[0].neutral == 1.0:
        return sigma * fit.values[hypothesis.effect.parameters[0].name]
    return sigma * max(twin.parameter(name).read(twin.base_model) for name in spoken)


def own_sigmas(fit: Fit) -> np.ndarray:
    """(p,) sigma of the fit's unit coordinates, by Gauss-Newton at the fitted point."""
    return np.sqrt(np.diag(_covariance(fit)))


def _covariance(fit: Fit) -> np.ndarray:
    """(p, p) of the fit's unit coordinates."""
    believed = fit.problem.prior_slopes()
    inflated = inflation(fit.chi_square, fit.problem.effective_samples, len(fit.point))
    return unit_covariance(fit.slopes[: len(fit.slopes) - len(believed)], believed, inflated)


def own_estimates(fit: Fit, seen_by: Fit | None = None) -> dict[str, Estimate]:
    """The effect's values by parameter with their intervals; those of another look at the same fit, with `seen_by`."""
    values, sigmas, found = fit.values, own_sigmas(fit), {}
    for index, variable in fit.own_variables:
        interval = value_interval(seen_by or fit, index, variable, sigmas[index])
        found[variable.parameter] = estimated(variable, values[variable.parameter], interval)
    return found


def moved_parameters(fit: Fit) -> tuple[MovedParameter, ...]:
    """The nominal parameters whose interval leaves their own value out, and those that are far off in any case.

    A fit of nuisances ends where it leaves no more than the floor; where they lie is read one Gauss-Newton step on.
    """
    problem, above, spread = fit.problem, max(1.0, fit.chi_square), _covariance(fit)
    slopes, rows = fit.slopes, problem.residuals(fit.point[None])[0]
    step = np.linalg.solve(slopes.T @ slopes / above + BOX_INFORMATION * np.eye(len(fit.point)), slopes.T @ rows)
    best = np.clip(fit.point - step / above, 0.0, 1.0)
    deviations = problem.deviations(best)
    variables = {variable.name: variable for variable in problem.variables if variable.prior is not None}
    found = []
    for (name, variable), row in zip(variables.items(), problem.prior_slopes(), strict=True):
        assert variable.prior is not None
        sigma, known_to = deviations[name], variable.prior.sigma
        if isinstance(variable, ParameterVariable) and variable.factor:
            unit = problem.twin.parameter(variable.parameters[0]).kind.unit
            weighed = weighed_share(problem.twin, unit) / known_to
            half = Z95 * float(np.hypot(np.sqrt(row @ spread @ row), weighed))  # in its prior's sigma
            if abs(sigma) > max(half, SPOKEN_SIGMA):
                low, middle, high = (float(np.exp(known_to * s)) for s in (sigma - half, sigma, sigma + half))
                ratio = {"of_nominal": middle, "of_nominal_ci95": (low, high), "known_to": known_to}
                found.append(MovedParameter(parameter=name, sigma=sigma, **ratio))
        elif abs(fit.deviations[name]) > DEVIATING_SIGMA and not isinstance(variable, EffectVariable):
            found.append(MovedParameter(parameter=name, sigma=fit.deviations[name]))
    return (
        *found,
        *(
            MovedParameter(parameter=name, sigma=sigma)
            for name, sigma in fit.deviations.items()
            if name not in variables and abs(sigma) > DEVIATING_SIGMA
        ),
    )
