"""What the earlier session says on its own: its values, the effects that it shows, and what the model leaves of it."""

from __future__ import annotations

import numpy as np

from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.thresholds import FINALISTS, MOST_PRESENT, PRESENT_NATS, PRESENT_SHARE, WITHIN


def settled(pair: Pair) -> tuple[Pair, Fit | None]:
    """The pair with its noise as the earlier session has it, with the effects in its models that this shows."""
    if pair.before is None:
        _look(pair, pair.start)
        return pair, None
    alone = pair.baseline_only()
    fit = alone.fit(())
    _look(alone, fit.point)
    fit = _with_columns(alone, fit)
    for _ in range(MOST_PRESENT):
        again = _with_another(alone, fit)
        if again is None:
            break
        alone, fit = again.pair, again
    fit = alone.fit((), _weighed(alone, fit))
    pair = pair.with_active(alone.now.active)
    assert alone.before is not None
    assert pair.before is not None
    pair.before.columns, pair.before.weights = alone.before.columns, alone.before.weights
    pair.now.columns, pair.now.weights = alone.now.columns, alone.now.weights
    rows = pair.rows(fit.point)
    return pair, Fit(pair, fit.point, rows, pair.slopes(fit.point, rows), frozenset())


def _look(pair: Pair, point: np.ndarray) -> None:
    for session, at in zip((pair.before, pair.now), pair.points(point), strict=True):
        if session is not None:
            for index, quantity in enumerate(pair.now.quantities):
                if not quantity.is_parameter and index not in session.active:
                    session.look_at(at, index)


def _weighed(alone: Pair, fit: Fit) -> Fit:
    """A fit of the earlier session with what that leaves as its noise: the later one may leave as much."""
    assert alone.before is not None
    old = alone.before.weights
    variance, correlated_s = alone.before.spread(alone.points(fit.point)[0])
    alone.before.weigh(variance, correlated_s)
    alone.now.weigh(variance, correlated_s)
    times = alone.before.weights / old
    return Fit(alone, fit.point, fit.rows * times, fit.slopes * times[:, None], fit.changed)


def _with_columns(alone: Pair, fit: Fit) -> Fit:
    """A fit whose derivative has the columns that have been differenced since."""
    assert alone.before is not None
    slopes = fit.slopes.copy()
    for index, column in alone.before.columns.items():
        if index not in alone.before.active:
            slopes[:, index] = column * alone.before.weights
    return Fit(alone, fit.point, fit.rows, slopes, fit.changed)


def _with_another(alone: Pair, fit: Fit) -> Fit | None:
    """The earlier session with one more effect in its model, if that takes away much of what is above the floor."""
    assert alone.before is not None
    above = float((fit.rows**2).sum()) > WITHIN * alone.before.floor_cost
    gains: dict[int, float] = {}
    for index, quantity in enumerate(alone.now.quantities):
        if above and quantity.grows and index not in alone.now.active:
            aim, evidence = fit.expected((index,))
            if aim[index] > 0.0 and evidence - fit.log_evidence > PRESENT_NATS:
                gains[index] = evidence
    found: list[Fit] = []
    for index in sorted(gains, key=lambda i: -gains[i])[:FINALISTS]:
        begun = Fit(alone, fit.expected((index,))[0], fit.rows, fit.slopes, fit.changed)
        found.append(alone.with_active(alone.now.active | {index}).fit((), begun))
    best = min(found, key=lambda one: one.cost, default=None)
    return best if best is not None and best.cost < PRESENT_SHARE * fit.cost else None
