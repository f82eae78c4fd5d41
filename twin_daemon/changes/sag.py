"""A weaker servo and a softer tendon: in series they yield alike, and only the motor's own motion tells them apart."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from twin_daemon.changes.joint_fit import Fit
from twin_daemon.changes.thresholds import FIRST_ROUNDS, MOTOR_SHARE, OTHER_SHARES


def softer_tendons(fits: Mapping[int, Fit], chosen: tuple[int, ...]) -> dict[int, Fit]:
    """By the index of an elastic tendon the best fit of its change in the place of the gain that its servo has lost.

    How much of damping and inertia is on the motor's side of the tendon nobody knows: several shares are tried.
    """
    found: dict[int, Fit] = {}
    for gain, fit in fits.items():
        every = fit.pair.now.quantities
        lost = float(fit.point[fit.pair.count + gain])
        if every[gain].effect != "actuator_gain" or lost >= 0.0:
            continue
        for tendon, quantity in enumerate(every):
            if quantity.effect == "tendon_elasticity" and quantity.target == every[gain].target:
                shares = (MOTOR_SHARE, *OTHER_SHARES) if tendon not in fit.pair.now.active else ()
                begun = [_instead(fit, gain, tendon, share) for share in shares or (quantity.motor_share,)]
                raced = [one.pair.fit((*chosen, tendon), one, FIRST_ROUNDS) for one in begun]
                found[tendon] = max(raced, key=lambda one: one.log_evidence)
    return found


def _instead(fit: Fit, gain: int, tendon: int, share: float) -> Fit:
    """Where a tendon has become softer by as much as the servo yields more with the gain that it has lost."""
    q, every = fit.pair.count, fit.pair.now.quantities
    pair = fit.pair.with_quantity(tendon, replace(every[tendon], motor_share=share))
    pair = pair.with_active(pair.now.active | {tendon})
    point = fit.point.copy()
    yields = float(np.exp(-point[q + gain])) - 1.0  # of the servo's own compliance
    point[q + tendon] += every[tendon].typical * yields / (every[gain].nominal * float(np.exp(point[gain])))
    point[q + gain] = 0.0
    rows = pair.rows(point)
    return Fit(pair, point, rows, pair.slopes(point, rows), frozenset())
