"""Friction that a colder or a warmer day explains: it goes with all joints, and no further than grease does."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.changes.group_search import GroupFound
from twin_daemon.changes.quantities import Quantity
from twin_daemon.changes.thresholds import TEMPERATURE
from twin_daemon.estimation.thresholds import Z95

NOTE = (
    "a colder or a warmer day changes the friction of all joints by as much: --covariate FILE.csv says how warm it "
    "was, and motion of other joints whether theirs has changed"
)

_FRICTION = ("viscous_friction", "coulomb_friction")


def explains(found: Sequence[GroupFound], group: GroupFound, index: int, warmed: float) -> bool:
    """Whether a change of one quantity may be the temperature's: friction, no more of it than `warmed` standard
    deviations of the temperature make, and no joint beside it that would have shown as much and has not."""
    if not _is_friction(group.quantities[index]):
        return False
    low, high = _moved(group, index)
    if max(low, -high, 0.0) > TEMPERATURE * warmed:
        return False
    return not any(
        _contradicts(other, i, low, high)
        for other in found
        for i, quantity in enumerate(other.quantities)
        if _is_friction(quantity) and quantity.effect == group.quantities[index].effect
        if not (other is group and i == index)
    )


def _contradicts(group: GroupFound, index: int, low: float, high: float) -> bool:
    """Whether that quantity has not gone by `low` to `high` of its logarithm, as it would by a factor of all joints."""
    if index in group.changed:
        least, most = _moved(group, index)
        return least > high or most < low
    seen_from = group.seen_from.get(index, np.inf)
    return seen_from <= max(low, -high, 0.0)


def _moved(group: GroupFound, index: int) -> tuple[float, float]:
    """The 95 % interval of a change's logarithm."""
    delta = len(group.quantities) + index
    half = Z95 * float(np.sqrt(max(group.fit.covariance[delta, delta], 0.0)))
    return float(group.fit.point[delta]) - half, float(group.fit.point[delta]) + half


def _is_friction(quantity: Quantity) -> bool:
    return quantity.is_parameter and quantity.effect in _FRICTION
