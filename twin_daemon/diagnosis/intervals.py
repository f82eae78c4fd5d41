"""How sure the values of a fitted effect are."""

from __future__ import annotations

import numpy as np

from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.nuisances import PARAMETER_SIGMA
from twin_daemon.fitting.knobs import Knob

_FLOOR = 0.02
_TORQUE_FLOOR = 1.96 * 0.5 * PARAMETER_SIGMA


def knob_interval(fit: Fit, knob: Knob, sigma: float) -> tuple[float, float]:
    """95 % interval of an effect's parameter from its unit sigma, with a floor of 2 % of the value; 12 % for torques.

    A torque is seen as a part of the servo's stiffness, of which only gravity and inertia tell the size: they are
    worth less than their rows claim, as the hidden suite shows. An effect that speaks for a
    nominal parameter is known no better than the nominal parameter is.
    """
    index = fit.problem.knobs.index(knob)
    unit = fit.point[index]
    low, high = knob.value(max(unit - 1.96 * sigma, 0.0)), knob.value(min(unit + 1.96 * sigma, 1.0))
    value = knob.value(unit)
    half = np.array([value - low, high - value])
    least = (_TORQUE_FLOOR if "N m" in knob.unit else _FLOOR) * abs(value)
    half = np.hypot(half, max(least, 1.96 * _nominal_sigma(fit, knob)))
    return value - float(half[0]), value + float(half[1])


def stands_out(fit: Fit) -> bool:
    """Whether the 95 % interval of an effect that the model has already leaves out what it has."""
    if fit.hypothesis is None or not fit.hypothesis.speaks_for(fit.problem.twin):
        return True
    widths, effect = unit_sigmas(fit), fit.hypothesis.effect
    neutral, amplitudes = effect.neutral(), effect.amplitudes or (effect.parameters[0].name,)
    for index, knob in fit.own_knobs:
        name = knob.name.rpartition(".")[2]
        low, high = knob_interval(fit, knob, widths[index])
        if name in amplitudes and not low <= neutral[name] <= high:
            return True
    return False


def _nominal_sigma(fit: Fit, knob: Knob) -> float:
    """What the nominal parameter's own uncertainty adds to an effect's, in the knob's unit."""
    hypothesis, twin = fit.hypothesis, fit.problem.twin
    if hypothesis is None or knob.name != f"{hypothesis.name}.{hypothesis.effect.parameters[0].name}":
        return 0.0
    spoken = hypothesis.speaks_for(twin)
    if not spoken:
        return 0.0
    if hypothesis.effect.parameters[0].neutral == 1.0:
        return PARAMETER_SIGMA * fit.values[hypothesis.effect.parameters[0].name]
    return PARAMETER_SIGMA * max(twin.parameter(name).read(twin.base_model) for name in spoken)


def unit_sigmas(fit: Fit) -> np.ndarray:
    """(p,) one-sigma widths of the fit's knobs in unit coordinates, by Gauss-Newton at the fitted point."""
    # a residual above the floor is not noise of the size assumed: the interval widens with it
    inflation = max(1.0, fit.chi_square)
    information = fit.slopes.T @ fit.slopes / inflation + 12.0 * np.eye(len(fit.point))
    return np.sqrt(np.diag(np.linalg.inv(information)))
