"""How sure the values of a fitted effect are."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from twin_daemon.diagnosis.fit import Fit
from twin_daemon.estimation.thresholds import PARAMETER_SIGMA
from twin_daemon.estimation.uncertainty import Estimate, estimated, unit_sigmas, widened
from twin_daemon.estimation.variables import EffectVariable

VALUE_FLOOR = 0.02
TORQUE_FLOOR = 1.96 * 0.5 * PARAMETER_SIGMA


def value_interval(fit: Fit, index: int, variable: EffectVariable, sigma: float) -> tuple[float, float]:
    """95 % interval of an effect's value from the sigma of its unit coordinate, at least 2 % of it; 12 % for torques.

    A torque is seen as a part of the servo's stiffness, of which only gravity and inertia tell the size: they are
    worth less than their rows claim, as the hidden suite shows. An effect that speaks for a nominal parameter is known
    no better than the nominal parameter is.
    """
    value = variable.value(fit.point[index])
    least = (TORQUE_FLOOR if "N m" in variable.unit else VALUE_FLOOR) * abs(value)
    return widened(variable, fit.point[index], sigma, max(least, 1.96 * _nominal_sigma(fit, variable)))


def stands_out(fit: Fit) -> bool:
    """Whether the 95 % interval of an effect that the model has already leaves out what it has."""
    if fit.hypothesis is None or not fit.hypothesis.speaks_for(fit.problem.twin):
        return True
    effect = fit.hypothesis.effect
    return _leave_neutral(fit, effect.amplitudes or (effect.parameters[0].name,))


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
    if hypothesis.effect.parameters[0].neutral == 1.0:
        return PARAMETER_SIGMA * fit.values[hypothesis.effect.parameters[0].name]
    return PARAMETER_SIGMA * max(twin.parameter(name).read(twin.base_model) for name in spoken)


def own_sigmas(fit: Fit) -> np.ndarray:
    """(p,) sigma of the fit's unit coordinates, by Gauss-Newton at the fitted point."""
    return unit_sigmas(fit.slopes, max(1.0, fit.chi_square))


def own_estimates(fit: Fit, seen_by: Fit | None = None) -> dict[str, Estimate]:
    """The effect's values by parameter with their intervals; those of another look at the same fit, with `seen_by`."""
    values, sigmas, found = fit.values, own_sigmas(fit), {}
    for index, variable in fit.own_variables:
        interval = value_interval(seen_by or fit, index, variable, sigmas[index])
        found[variable.parameter] = estimated(variable, values[variable.parameter], interval)
    return found
