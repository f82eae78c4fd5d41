"""Changes held against each other in one and the same model of both sessions."""

from __future__ import annotations

from collections.abc import Mapping

from twin_daemon.changes.joint_fit import Fit
from twin_daemon.changes.thresholds import COMPARABLE_NATS


def beside_the_same(fit: Fit, fits: Mapping[int, Fit], chosen: tuple[int, ...]) -> dict[int, Fit]:
    """Other changes, of what there is anyway, where both sessions have the effect of the best one.

    An effect that changes is in the models of both sessions, and what it takes off the earlier one is no evidence of
    its change: others are held against it where they have that, too. Each is begun where the best one has ended, and
    there with its own change in that one's place. Where one of them ends better, so is the first.
    """
    first = max(fits, key=lambda i: fits[i].log_evidence, default=None)
    if first is None or fits[first].pair.now.active == fit.pair.now.active:
        return {}
    best, found = fits[first], {}
    for index, quantity in enumerate(best.pair.now.quantities):
        if quantity.wears and index not in (*chosen, first) and best.pair.is_present(index):
            other = _in_its_place(best, first, index, fits.get(index), chosen)
            found |= {} if other is None else {index: other}
    better = max(found, key=lambda i: found[i].log_evidence, default=None)
    if better is not None and found[better].log_evidence > best.log_evidence:
        again = _in_its_place(found[better], better, first, best, chosen)
        found |= {} if again is None else {first: again}
    return found


def _in_its_place(best: Fit, first: int, index: int, known: Fit | None, chosen: tuple[int, ...]) -> Fit | None:
    """A change in the model of the best one; None where it is out of reach. `known` is what there is of it."""
    changed = (*chosen, index)
    begun = [best, *([_instead(best, first, known, index)] if known is not None else [])]
    if max(one.expected(changed)[1] for one in begun) <= best.log_evidence - COMPARABLE_NATS:
        return None
    return max((best.pair.fit(changed, one) for one in begun), key=lambda one: one.log_evidence)


def _instead(best: Fit, first: int, other: Fit, index: int) -> Fit:
    """Where the best change has ended, with another one as it has been found in its place."""
    point = best.point.copy()
    point[best.pair.count + first] = 0.0
    point[best.pair.count + index] = other.point[other.pair.count + index]
    rows = best.pair.rows(point)
    return Fit(best.pair, point, rows, best.pair.slopes(point, rows), frozenset())
