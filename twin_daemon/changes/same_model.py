"""Changes held against each other in one and the same model of both sessions."""

from __future__ import annotations

from collections.abc import Mapping

from twin_daemon.changes.joint_fit import Fit
from twin_daemon.changes.thresholds import COMPARABLE_NATS


def beside_the_same(fit: Fit, fits: Mapping[int, Fit], chosen: tuple[int, ...]) -> dict[int, Fit]:
    """Other changes, of what there is anyway, where both sessions have the effect of the best one.

    An effect that changes is in the models of both sessions, and what it takes off the earlier one is no evidence of
    its change: others are held against it where they have that, too. Each is begun where the best one has ended, and
    there with its own change in that one's place.
    """
    first = max(fits, key=lambda i: fits[i].log_evidence, default=None)
    if first is None or fits[first].pair.now.active == fit.pair.now.active:
        return {}
    best, found = fits[first], {}
    for index, quantity in enumerate(best.pair.now.quantities):
        if not quantity.wears or index in (*chosen, first) or not best.pair.is_present(index):
            continue
        changed = (*chosen, index)
        begun = [best, *([_instead(best, first, fits[index], index)] if index in fits else [])]
        if max(one.expected(changed)[1] for one in begun) > best.log_evidence - COMPARABLE_NATS:
            found[index] = max((best.pair.fit(changed, one) for one in begun), key=lambda one: one.log_evidence)
    return found


def _instead(best: Fit, first: int, other: Fit, index: int) -> Fit:
    """Where the best change has ended, with another one as it has been found in its place."""
    point = best.point.copy()
    point[best.pair.count + first] = 0.0
    point[best.pair.count + index] = other.point[other.pair.count + index]
    rows = best.pair.rows(point)
    return Fit(best.pair, point, rows, best.pair.slopes(point, rows), frozenset())
