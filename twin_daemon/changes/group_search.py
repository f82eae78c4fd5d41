"""What has changed at one group of joints: the spike-and-slab posterior over its candidates, refitted in roll-outs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.quantities import Quantity, quantities
from twin_daemon.changes.sessions import Session
from twin_daemon.changes.thresholds import (
    APPEARS,
    COMPARABLE_NATS,
    FINALISTS,
    FIRST_ROUNDS,
    FURTHER_SHARE,
    MOST_CHANGES,
    MOST_PRESENT,
    NAMED,
    NOTHING_CHANGED,
    PRESENT_NATS,
    SEEN,
    TOLD_APART_NATS,
    WORTH_REFITTING,
)
from twin_daemon.estimation.nuisances import nuisance_variables
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.posterior import floor_and_corrections
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Believed:
    """What is known of shared amounts before: centre and sigma of z by a quantity's name."""

    centre: Mapping[str, float] = field(default_factory=dict)
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Sessions:
    """Pieces of a group's motion: of the earlier session (none where a version stands for it), of the later one, and of
    the later one's that is held out."""

    before: tuple[Aligned, ...]
    now: tuple[Aligned, ...]
    held: tuple[Aligned, ...] = ()


@dataclass
class GroupFound:
    """What one group says, by the index of a quantity; `fit` has the changes that are named.

    `evidence` is the gain over no change in nats, `rivals` are changes that explain the same, `seen_from` the smallest
    change of z that would have been seen. `left` is the mean square of what is left of the later session over that of
    the earlier one, `before_left` without any change. `held_squares` (rad^2) are held-out squared errors without and
    with the changes, empty where nothing was held out.
    """

    name: str
    joints: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    fit: Fit
    changed: tuple[int, ...]
    probability: dict[int, float]
    evidence: dict[int, float]
    rivals: dict[int, tuple[int, ...]]
    seen_from: dict[int, float]
    before_left: float
    left: float
    held_squares: tuple[np.ndarray, np.ndarray] = (np.empty(0), np.empty(0))


def search_group(reduced: Reduced, sessions: Sessions, candidates: int, believed: Believed | None = None) -> GroupFound:
    """One group's changes. `candidates` is how many changes are looked for in the whole robot: each pays for that."""
    twin, joints = reduced.twin, reduced.joints
    every = quantities(twin, joints)
    floor, _ = _floor(twin, sessions.before or sessions.now, joints)
    earlier = _session(twin, sessions.before, joints, every, floor) if sessions.before else None
    later = _session(twin, sessions.now, joints, every, floor)
    known = believed or Believed()
    means = np.array([known.centre.get(q.name, 0.0) for q in every])
    sigmas = np.array([known.sigma.get(q.name, q.shared_sigma) for q in every])
    pair, start = _settled(Pair(earlier, later, means, sigmas))
    price = float(np.log((1.0 - NOTHING_CHANGED) / NOTHING_CHANGED / max(candidates, 1)))
    found = _select(reduced.name, pair, start, price)
    if sessions.held:
        found.held_squares = _held_squares(found, _session(twin, sessions.held, joints, every, floor))
    return found


def _floor(twin: TwinModel, pieces: Sequence[Aligned], joints: Sequence[str]) -> tuple[np.ndarray, list[np.ndarray]]:
    return floor_and_corrections(twin, pieces, nuisance_variables(twin, pieces, joints), joints)


def _session(
    twin: TwinModel,
    pieces: tuple[Aligned, ...],
    joints: tuple[str, ...],
    every: tuple[Quantity, ...],
    floor: np.ndarray,
) -> Session:
    return Session(twin, pieces, joints, every, floor, _floor(twin, pieces, joints)[1])


def _settled(pair: Pair) -> tuple[Pair, Fit | None]:
    """The pair with its noise as the earlier session has it, with the effects in its models that this shows."""
    if pair.before is None:
        _look(pair, pair.start)
        return pair, None
    alone = pair.baseline_only()
    fit = alone.fit(())
    _look(alone, fit.point)
    fit = alone.fit((), _weighed(alone, fit))
    for _ in range(MOST_PRESENT):
        shown = _shown(alone, fit)
        if shown is None:
            break
        begun = Fit(alone, fit.expected((shown,))[0], fit.rows, fit.slopes, fit.changed)
        again = alone.with_active(alone.now.active | {shown}).fit((), begun)
        if again.log_evidence < fit.log_evidence + PRESENT_NATS:
            break
        alone = again.pair
        fit = alone.fit((), _weighed(alone, again))
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
    slopes = fit.slopes * times[:, None]
    for index, column in alone.before.columns.items():
        if index not in alone.before.active:
            slopes[:, index] = column * alone.before.weights
    return Fit(alone, fit.point, fit.rows * times, slopes, fit.changed)


def _shown(alone: Pair, fit: Fit) -> int | None:
    """The effect that the earlier session asks for most, if it does."""
    gains: dict[int, float] = {}
    for index, quantity in enumerate(alone.now.quantities):
        if quantity.grows and index not in alone.now.active:
            aim, evidence = fit.expected((index,))
            if aim[index] > 0.0:
                gains[index] = evidence - fit.log_evidence
    best = max(gains, key=lambda index: gains[index], default=None)
    return best if best is not None and gains[best] > PRESENT_NATS else None


def _select(name: str, pair: Pair, start: Fit | None, price: float) -> GroupFound:
    """Greedy forward selection: a change is taken in while it is probable that there is another, all refitted."""
    without = found = pair.fit((), start)
    chosen: tuple[int, ...] = ()
    probability: dict[int, float] = {}
    evidence: dict[int, float] = {}
    rivals: dict[int, tuple[int, ...]] = {}
    for _ in range(MOST_CHANGES):
        fits, odds = _tried(found, start if not chosen else None, chosen, price)
        total = float(np.logaddexp.reduce([0.0, *odds.values()]))
        shares = {index: float(np.exp(odd - total)) for index, odd in odds.items()}
        best = max(fits, key=lambda index: shares[index], default=None)
        probability |= {i: s for i, s in shares.items() if i not in chosen}
        if best is None or sum(shares.values()) < NAMED:
            break
        gained = fits[best].log_evidence - found.log_evidence
        if chosen and gained < FURTHER_SHARE * evidence[chosen[0]]:
            break
        rivals[best] = tuple(
            i for i, f in fits.items() if i != best and fits[best].log_evidence - f.log_evidence < TOLD_APART_NATS
        )
        evidence[best] = gained
        chosen, found = (*chosen, best), fits[best]
    seen_from = _seen_from(found, price)
    return GroupFound(
        name,
        pair.now.joints,
        pair.now.quantities,
        found,
        chosen,
        probability,
        evidence,
        rivals,
        seen_from,
        _left(without),
        _left(found),
    )


def _held_squares(found: GroupFound, held: Session) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors (n,) rad^2 on held-out motion, the earlier session's values against those with the changes."""
    q, point = len(found.quantities), found.fit.point
    held = held.with_active(found.fit.pair.now.active)
    delays = np.zeros(len(held.onset_sigmas))
    changes = np.where(np.isin(np.arange(q), found.changed), point[q : 2 * q], 0.0)
    known = np.array([i in held.active or quantity.is_parameter for i, quantity in enumerate(found.quantities)])
    both = [np.concatenate([np.where(known, z, 0.0), delays]) for z in (point[:q], point[:q] + changes)]
    squares = held.gaps(np.array(both)) ** 2
    return squares[0], squares[1]


def _tried(
    fit: Fit, start: Fit | None, chosen: tuple[int, ...], price: float
) -> tuple[dict[int, Fit], dict[int, float]]:
    """(fits of the finalists, log odds of each further change over none), to first order where it is no finalist.

    `start` is where the earlier session's own fit ends: a change is often found from there, as `fit` has had to make up
    for it.
    """
    pair = fit.pair
    odds: dict[int, float] = {}
    begun: dict[int, list[Fit]] = {}
    for index, quantity in enumerate(pair.now.quantities):
        if not quantity.wears or index in chosen:
            continue
        for origin in (fit, *([start] if start is not None else [])):
            aim, evidence = origin.expected((*chosen, index))
            if quantity.grows and min(aim[pair.count + index], aim[index] + aim[pair.count + index]) < 0.0:
                continue  # less than none of it
            gained = evidence - origin.expected(chosen)[1]
            if index not in odds or gained > odds[index]:
                odds[index] = gained
            begun.setdefault(index, []).append(origin)
    priors = {i: price + (0.0 if _is_present(pair, i) else float(np.log(APPEARS))) for i in odds}
    posterior = {index: odds[index] + priors[index] for index in odds}
    fits: dict[int, Fit] = {}
    worth = sorted((i for i in odds if odds[i] > WORTH_REFITTING), key=lambda i: -odds[i])
    # to first order an effect that is not smooth may promise anything: all of them that do are refitted
    smooth = [i for i in worth if not pair.now.quantities[i].grows][:FINALISTS]
    best = -np.inf
    for index in (*smooth, *(i for i in worth if pair.now.quantities[i].grows)):
        changed = (*chosen, index)
        begins = [_refitted(origin, changed, index, FIRST_ROUNDS) for origin in begun[index]]
        found = max(begins, key=lambda one: one.log_evidence)
        if found.log_evidence > best - COMPARABLE_NATS:
            found = found.pair.fit(changed, found)
        fits[index], best = found, max(best, found.log_evidence)
        # against the same model of both sessions without the change, too: what it adds to both is no change
        gained = found.log_evidence - max(fit.log_evidence, found.expected(chosen)[1])
        posterior[index] = gained + priors[index]
    return fits, posterior


def _refitted(origin: Fit, changed: tuple[int, ...], index: int, rounds: int) -> Fit:
    """A change fitted in roll-outs; an effect is put into the models of both sessions for that."""
    pair, quantity = origin.pair, origin.pair.now.quantities[index]
    if not quantity.grows or index in pair.now.active:
        return pair.fit(changed, origin, rounds)
    aim = origin.expected(changed)[0]
    begun = Fit(pair, aim, origin.rows, origin.slopes, origin.changed)
    return pair.with_active(pair.now.active | {index}).fit(changed, begun, rounds)


def _is_present(pair: Pair, index: int) -> bool:
    """Whether the model of the earlier session has it."""
    return pair.now.quantities[index].is_parameter or index in pair.now.active or pair.now.quantities[index].signed


def _seen_from(fit: Fit, price: float) -> dict[int, float]:
    """By quantity the change of z from which its probability would have been SEEN, had nothing else changed."""
    found = {}
    for index, quantity in enumerate(fit.pair.now.quantities):
        if quantity.wears:
            variance = fit.said_of(index)[1]
            spike, slab = variance + quantity.spike**2, variance + quantity.slab**2
            asked = (
                float(np.log(SEEN / (1.0 - SEEN))) - price + 0.5 * float(np.log(slab / spike))
                if np.isfinite(variance)
                else np.inf
            )
            found[index] = float(np.sqrt(2.0 * asked / (1.0 / spike - 1.0 / slab))) if np.isfinite(asked) else np.inf
    return found


def _left(fit: Fit) -> float:
    """Mean square of the later session's rows over the earlier one's, or over its noise where there is none."""
    pair = fit.pair
    size = len(pair.before.weights) if pair.before else 0
    later = float((fit.rows[size:] ** 2).mean())
    earlier = float((fit.rows[:size] ** 2).mean()) if pair.before else later
    return later / max(earlier, 1e-30)
