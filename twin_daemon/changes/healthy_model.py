"""What the earlier session says on its own: its values, the effects that it shows, and what the model leaves of it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import numpy as np

from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.thresholds import (
    FINALISTS,
    FIRST_ROUNDS,
    MOST_PRESENT,
    PRESENT_NATS,
    PRESENT_SHARE,
    PRESENT_START,
    WITHIN,
)
from twin_daemon.diagnosis.candidates import candidate, informed
from twin_daemon.effects import LIBRARY


def settled(pair: Pair, fit: Fit | None) -> tuple[Pair, Fit | None]:
    """The pair with its noise as the earlier session has it, with the effects in its models that this shows.

    `fit` is of that session alone, None where a version stands for it.
    """
    if pair.before is None or fit is None:
        _look(pair, pair.start)
        return _placed(pair, pair.start), None
    alone = fit.pair
    _look(alone, fit.point)
    fit = _with_columns(alone, fit)
    for _ in range(MOST_PRESENT):
        again = _with_another(alone, fit)
        if again is None:
            break
        alone, fit = again.pair, again
    fit = alone.fit((), _weighed(alone, fit))
    for index in alone.now.active:
        pair = pair.with_quantity(index, alone.now.quantities[index])
    pair = pair.with_active(alone.now.active)
    assert alone.before is not None
    assert pair.before is not None
    pair.before.columns, pair.before.weights = alone.before.columns, alone.before.weights
    pair.now.columns, pair.now.weights = alone.now.columns, alone.now.weights
    pair = _placed(pair, fit.point)
    rows = pair.rows(fit.point)
    return pair, Fit(pair, fit.point, rows, pair.slopes(fit.point, rows), frozenset())


def _placed(pair: Pair, point: np.ndarray) -> Pair:
    """The pair with springs that stiffen slack where the later session would have them, if there are any."""
    gaps = pair.now.gaps_by_piece(pair.points(point)[1])
    twin, every = pair.now.twin, pair.now.quantities
    for index, quantity in enumerate(every):
        owner = next((i for i, other in enumerate(every) if other.name == quantity.beside), None)
        if owner is None or owner in pair.now.active or quantity.parameter != "centre":
            continue
        usual = candidate(LIBRARY[quantity.effect], quantity.target, twin, quantity.target)
        found = informed(usual, twin, pair.now.pieces, pair.now.joints, gaps)
        if found is not usual:
            pair = pair.with_quantity(index, replace(quantity, nominal=found.starts[0]["centre"]))
            pair = pair.with_quantity(owner, every[owner])  # what is known of it was about another centre
            _look(pair, point, (owner, index))
    return pair


def _look(pair: Pair, point: np.ndarray, among: Collection[int] = ()) -> None:
    """Differences the effects that are not in the models at a point, or these of them."""
    for session, at in zip((pair.before, pair.now), pair.points(point), strict=True):
        if session is not None:
            for index, quantity in enumerate(pair.now.quantities):
                asked = not among or index in among
                if asked and not quantity.is_parameter and index not in session.active:
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
    """The earlier session with one more effect in its model, if that takes away much of what is above the floor.

    Every effect is begun where the fit without it promises it, and beside the model's own values: without it others
    have made up for it, and from where those have come to the way back may be closed.
    """
    assert alone.before is not None
    if float((fit.rows**2).sum()) <= WITHIN * alone.before.floor_cost:
        return None
    raced: list[Fit] = []
    for index, quantity in enumerate(alone.now.quantities):
        if quantity.grows and index not in alone.now.active:
            laws = [alone.with_quantity(index, law) for law in quantity.laws()]
            begun = [_begun(law, point, index) for law in laws for point in _starts(alone, fit, index)]
            raced += [one.pair.fit((), one, FIRST_ROUNDS) for one in begun if np.isfinite(one.cost)]
    raced.sort(key=lambda one: one.cost)
    best = min((one.pair.fit((), one) for one in raced[:FINALISTS]), key=lambda one: one.cost, default=None)
    if best is None or best.cost >= PRESENT_SHARE * fit.cost:
        return None
    return best if best.log_evidence > fit.log_evidence + PRESENT_NATS else None


def _starts(alone: Pair, fit: Fit, index: int) -> list[np.ndarray]:
    """Points from which an effect is fitted to the earlier session."""
    promised = fit.expected((index,))[0]
    beside = np.where(np.arange(len(fit.point)) < alone.count, alone.start, fit.point)
    beside[list(alone.now.active)] = fit.point[list(alone.now.active)]
    beside[index] = PRESENT_START
    return [*([promised] if promised[index] > 0.0 else []), beside]


def _begun(alone: Pair, point: np.ndarray, index: int) -> Fit:
    there = alone.with_active(alone.now.active | {index})
    rows = there.rows(point)
    return Fit(there, point, rows, there.slopes(point, rows), frozenset())
