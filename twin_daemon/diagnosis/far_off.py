"""Uncertain values that are further off than a hand of this kind may be: they stand in for what is missing."""

from __future__ import annotations

import numpy as np

from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import DEVIATING_SIGMA, FORBIDDEN_SIGMA
from twin_daemon.estimation.variables import EffectVariable


def deviating(part: PartFit) -> dict[str, float]:
    """The nuisances that are too far from their priors to be nuisances, in sigma."""
    values = {variable.name for variable in part.variables if isinstance(variable, EffectVariable)}
    deviations = part.base.deviations.items()
    return {name: sigma for name, sigma in deviations if name not in values and abs(sigma) > DEVIATING_SIGMA}


def plainly_above(part: PartFit) -> bool:
    """Whether something is missing by what is fitted: more than its floor is left, or a value is no nuisance's."""
    return not part.within_floor or bool(deviating(part))


def beyond_any_hand(deviations: dict[str, float]) -> list[tuple[str, float]]:
    """Those that no plausible hand has: a right model forces no value so far."""
    return [(name, sigma) for name, sigma in deviations.items() if abs(sigma) > FORBIDDEN_SIGMA]


def needed(part: PartFit, allowed: np.ndarray) -> dict[str, float]:
    """Those that are too far off, without the ones that need not be: laws differ in form, and these take that up.

    Held to where they may be, with all others fitted beside them, they leave no more than `allowed` (k,) floors, what a
    right law may.
    """
    found = deviating(part)
    if not beyond_any_hand(found) or (part.times_plausible_floor > allowed).any():
        return found
    moved = {variable.name for variable in part.variables}
    return {name: sigma for name, sigma in found.items() if name not in moved}
