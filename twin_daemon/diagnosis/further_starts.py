"""Where a fit of a candidate begins once more: at what its first descent may have left behind, or not have reached."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.thresholds import COUNTED_NEARBY, MOVED_SIGMA
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.estimation.variables import effect_variable


def box_moved(fit: Fit) -> tuple[Posterior, np.ndarray] | None:
    """(the fit's problem with the box of what counts something about where that is, its point); None if it is inside.

    How near such a value is at its start is no matter of the error, but of how well a start can be read off it.
    """
    variables, units, moved = list(fit.problem.variables), fit.point.copy(), False
    counted = {p.name for p in fit.hypothesis.effect.parameters if p.held} if fit.hypothesis else set()
    for index, variable in fit.own_variables:
        value = variable.value(fit.point[index])
        if variable.parameter in counted and variable.at_bound(value):
            lower, upper = fit.hypothesis.bounds[variable.parameter] if fit.hypothesis else (value, value)
            lower, upper = max(lower, value / COUNTED_NEARBY), min(upper, value * COUNTED_NEARBY)
            if lower < value < upper:
                variables[index] = replace(variable, lower=lower, upper=upper, start=value)
                units[index], moved = variables[index].coordinate(value), True
    if not moved:
        return None
    problem = fit.problem
    return problem.over(problem.recordings, variables, problem.corrections), units


def refined(fit: Fit) -> tuple[Posterior, np.ndarray] | None:
    """(the fit's problem with what refines its effect as variables, its point); None where nothing does or is needed.

    Where all joints are at their floor no value of the effect is missing.
    """
    if fit.hypothesis is None or not any(p.refines for p in fit.hypothesis.effect.parameters):
        return None
    if (fit.problem.times_floor(fit.point) <= FLOOR_CHI_SQUARE).all():
        return None
    effect, target, problem = fit.hypothesis.effect, fit.hypothesis.target, fit.problem
    free = {variable.parameter for _, variable in fit.own_variables}
    more = [
        effect_variable(effect.key, target, p, fit.hypothesis.bounds[p.name], fit.values[p.name])
        for p in effect.parameters
        if p.refines and p.name not in free
    ]
    if not more:
        return None
    units = np.concatenate([fit.point, [variable.coordinate(variable.start) for variable in more]])
    return problem.over(problem.recordings, [*problem.variables, *more], problem.corrections), units


def begun_ends(fit: Fit) -> np.ndarray:
    """(p,) the fit's point with those of its effect's parameters that began at an end of their range back there."""
    point = fit.point.copy()
    for index, variable in fit.own_variables:
        begun = variable.coordinate(variable.start)
        if begun in (0.0, 1.0):
            point[index] = begun
    return point


def other_ends(fit: Fit) -> np.ndarray:
    """(p,) the fit's point with those of its effect's shares that have come to one end of their range at the other.

    Between friction that holds and friction that creeps at rest no slope leads from one to the other.
    """
    point = fit.point.copy()
    for index, variable in fit.own_variables:
        if (variable.lower, variable.upper, variable.unit) == (0.0, 1.0, "1") and variable.at_bound(
            variable.value(point[index])
        ):
            point[index] = np.round(1.0 - point[index])
    return point


def nominal_again(fit: Fit) -> np.ndarray:
    """(p,) the fit's point with the nuisances back where they start, if any has gone further than most should.

    They may have stood in for the effect before it was there, and a descent ends where they hold each other.
    """
    deviations, variables = fit.deviations, fit.problem.variables
    own = [variable.prior is None for variable in variables]
    if all(o or abs(deviations[v.name]) < MOVED_SIGMA for o, v in zip(own, variables, strict=True)):
        return fit.point
    return np.where(own, fit.point, fit.problem.start)
