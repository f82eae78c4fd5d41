"""A weaker servo and a softer tendon: in series they yield alike, and only the motor's own motion tells them apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.thresholds import DAMPING_SHARE, FIRST_ROUNDS, IN_SERIES_NATS


def least_apart(pair: Pair, one: int, other: int) -> float:
    """Nats by which one change has to beat another because of what is not known about a motor behind a tendon."""
    first, second = pair.now.quantities[one], pair.now.quantities[other]
    in_series = {first.effect, second.effect} == {"actuator_gain", "tendon_elasticity"}
    return float(IN_SERIES_NATS) if in_series and first.target == second.target else 0.0


def softer_tendons(fits: Mapping[int, Fit], chosen: tuple[int, ...]) -> dict[int, Fit]:
    """By the index of an elastic tendon the best fit of its change in the place of the gain that its servo has lost.

    Where the models have no such tendon it is begun as stiff as it has been, and as soft as makes up for what the servo
    lacks of its nominal gain.
    """
    found: dict[int, Fit] = {}
    for gain, fit in fits.items():
        every = fit.pair.now.quantities
        lost = float(fit.point[fit.pair.count + gain])
        if every[gain].effect != "actuator_gain" or lost >= 0.0:
            continue
        for tendon, quantity in enumerate(every):
            if quantity.effect == "tendon_elasticity" and quantity.wears and quantity.target == every[gain].target:
                begun = [_instead(fit, gain, tendon, fit.point)]
                if tendon not in fit.pair.now.active and fit.point[gain] < 0.0:
                    begun.append(_instead(fit, gain, tendon, _with_nominal_gain(fit, gain, tendon)))
                raced = [one.pair.fit((*chosen, tendon), one, FIRST_ROUNDS) for one in begun]
                found[tendon] = max(raced, key=lambda one: one.log_evidence)
    return found


def _instead(fit: Fit, gain: int, tendon: int, point: np.ndarray) -> Fit:
    """From a point of a fit a tendon that has become softer by as much as the servo yields more with the gain lost."""
    q, every = fit.pair.count, fit.pair.now.quantities
    pair = fit.pair.with_active(fit.pair.now.active | {tendon})
    yields = float(np.exp(-fit.point[q + gain])) - 1.0  # of the servo's own compliance
    point = point.copy()
    point[q + tendon] += every[tendon].typical * yields / (every[gain].nominal * float(np.exp(fit.point[gain])))
    point[q + gain] = 0.0
    rows = pair.rows(point)
    return Fit(pair, point, rows, pair.slopes(point, rows), frozenset())


def _with_nominal_gain(fit: Fit, gain: int, tendon: int) -> np.ndarray:
    """The point of a fit with the servo's nominal gain, and a tendon in series that yields as much as it was short."""
    every, point = fit.pair.now.quantities, fit.point.copy()
    share = float(np.exp(fit.point[gain]))  # of the nominal gain
    point[tendon] = every[tendon].typical * (1.0 / share - 1.0) / every[gain].nominal
    point[gain] = 0.0
    # what brakes the motor is felt at the joint by the square of how far the motor goes along with it
    felt = 1.0 - DAMPING_SHARE + DAMPING_SHARE * share**2
    for index, quantity in enumerate(every):
        if quantity.is_parameter and quantity.name.endswith(".damping") and quantity.target in every[tendon].joints:
            point[index] -= float(np.log(felt))
    return point
