"""What has changed at one group of joints: the spike-and-slab posterior over its candidates, refitted in roll-outs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from twin_daemon.changes.group import Group
from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.quantities import Quantity, with_companions
from twin_daemon.changes.sag import least_apart, softer_tendons
from twin_daemon.changes.same_model import beside_the_same
from twin_daemon.changes.sessions import Session
from twin_daemon.changes.thresholds import (
    APPEARS,
    COMPARABLE_NATS,
    FINALISTS,
    FIRST_ROUNDS,
    FURTHER_SHARE,
    MOST_CHANGES,
    NAMED,
    NOTHING_CHANGED,
    ROUGH,
    SEEN,
    TOLD_APART_NATS,
    WORTH_REFITTING,
)


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


def search_group(group: Group, candidates: int) -> GroupFound:
    """One group's changes. `candidates` is how many changes are looked for in the whole robot: each pays for that."""
    price = float(np.log((1.0 - NOTHING_CHANGED) / NOTHING_CHANGED / max(candidates, 1)))
    found = _select(group, price)
    if (held := group.held(found.quantities)) is not None:
        found.held_squares = _held_squares(found, held)
    return found


def _select(group: Group, price: float) -> GroupFound:
    """Greedy forward selection: a change is taken in while it is probable that there is another, all refitted."""
    pair, start, found = group.pair, group.start, group.without
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
        rivals[best] = _rivals(fits, best)
        evidence[best] = gained
        chosen, found = (*chosen, best), fits[best]
    kept, found = _needed(found, chosen, evidence, price)
    if kept:
        # what was the most probable one by itself, and has gone, explains the same as what has taken its place
        first = max(kept, key=lambda i: evidence[i])
        rivals[first] = (*rivals[first], *(i for i in chosen if i not in (*kept, *rivals[first])))
    chosen = kept
    seen_from = _seen_from(found, price)
    return GroupFound(
        group.reduced.name,
        pair.now.joints,
        found.pair.now.quantities,
        found,
        chosen,
        probability,
        evidence,
        rivals,
        seen_from,
        _left(group.without),
        _left(found),
    )


def _rivals(fits: Mapping[int, Fit], best: int) -> tuple[int, ...]:
    """Changes that the best one does not beat by as much as its own evidence scatters by where it has ended.

    Nor does it where only the widths of their priors tell them apart: play under a load that pulls one way reads like
    an offset of half the gap.
    """
    found, others = fits[best], [(i, one) for i, one in fits.items() if i != best]
    if not others:
        return ()
    apart = max(float(TOLD_APART_NATS), ROUGH * found.pair.roughness(found))
    nats = {i: min(found.log_evidence - one.log_evidence, 0.5 * (one.cost - found.cost)) for i, one in others}
    return tuple(i for i, one in others if nats[i] < max(apart, least_apart(one.pair, best, i)))


def _needed(
    found: Fit, chosen: tuple[int, ...], evidence: dict[int, float], price: float
) -> tuple[tuple[int, ...], Fit]:
    """The changes that are still needed beside the others, the fit with them, and in `evidence` what each adds there.

    The first one that was taken in may have stood for what a later one explains better.
    """
    while len(chosen) > 1:
        rest = {i: found.pair.fit(tuple(j for j in chosen if j != i), found) for i in chosen}
        evidence.update({i: found.log_evidence - without.log_evidence for i, without in rest.items()})
        least = min(chosen, key=lambda i: evidence[i])
        asked = float(np.log(NAMED / (1.0 - NAMED))) - price
        if evidence[least] >= max(asked, FURTHER_SHARE * max(evidence[i] for i in chosen)):
            break
        chosen, found = tuple(i for i in chosen if i != least), rest[least]
    return chosen, found


def _held_squares(found: GroupFound, held: Session) -> tuple[np.ndarray, np.ndarray]:
    """Squared errors (n,) rad^2 on held-out motion, the earlier session's values against those with the changes."""
    q, point = len(found.quantities), found.fit.point
    held = held.with_active(found.fit.pair.now.active)
    delays = np.zeros(len(held.onset_sigmas))
    changed = with_companions(found.quantities, found.changed)
    changes = np.where(np.isin(np.arange(q), list(changed)), point[q : 2 * q], 0.0)
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
    pair, asked_for = fit.pair, fit.asks_for_an_effect
    odds: dict[int, float] = {}
    begun: dict[int, list[Fit]] = {}
    for index, quantity in enumerate(pair.now.quantities):
        if not quantity.wears or index in chosen or not (asked_for or pair.is_present(index)):
            continue
        for origin in (fit, *([start] if start is not None else [])):
            aim, evidence = origin.expected((*chosen, index))
            least = min(aim[pair.count + index], aim[index] + aim[pair.count + index])
            if quantity.grows and not quantity.may_only_pull and least < 0.0:
                continue  # less than none of it
            gained = evidence - origin.expected(chosen)[1]
            if index not in odds or gained > odds[index]:
                odds[index] = gained
            begun.setdefault(index, []).append(origin)
    posterior = {index: odd + _odds_before(pair, index, price) for index, odd in odds.items()}
    fits: dict[int, Fit] = {}
    there: dict[int, Fit] = {}
    none = fit.log_evidence
    worth = sorted((i for i in odds if odds[i] > WORTH_REFITTING), key=lambda i: -odds[i])
    # to first order an effect that is not smooth may promise anything: all of them that do are refitted
    smooth = [i for i in worth if not pair.now.quantities[i].grows][:FINALISTS]
    rough = [i for i in worth if pair.now.quantities[i].grows]
    asked = [*smooth, *rough]
    while asked:
        known = dict(fits)
        for index in asked:
            changed = (*chosen, index)
            first = [one for origin in begun[index] for one in _refitted(origin, changed, index)]
            first.sort(key=lambda one: -one.log_evidence)
            better = first[: (len(first) + 1) // 2]  # what is far behind after a step is not followed
            begins = [one.pair.fit(changed, one, FIRST_ROUNDS - 1) for one in better]
            fits[index] = _ended(max(begins, key=lambda one: one.log_evidence), changed, fits)
        fits |= _ended_tendons({i: fits[i] for i in asked}, chosen, fits)
        fitted = {index: found for index, found in fits.items() if found is not known.get(index)}
        without, ended = _best_without(fit, fitted, chosen)
        none = max(none, without)
        there |= _better(ended, there)
        posterior |= {i: found.log_evidence - none + _odds_before(pair, i, price) for i, found in fits.items()}
        # where the finalists have not kept what they promised, the next best is asked, until the best has been refitted
        top = max(posterior, key=posterior.__getitem__)
        asked = [top] if top in worth and top not in fits else []
    beside = beside_the_same(fit, fits, chosen)
    fits |= _better(beside, fits)
    tendons = _ended_tendons(beside, chosen, fits)
    fits |= tendons
    without, ended = _best_without(fit, beside | tendons, chosen)
    none = max(none, without)
    # last, so that what is begun from a change begins where that one's own descent has ended
    fits |= _better(there | _better(ended, there), fits)
    posterior |= {i: found.log_evidence - none + _odds_before(pair, i, price) for i, found in fits.items()}
    return fits, posterior


def _odds_before(pair: Pair, index: int, price: float) -> float:
    """Log odds of a change before any motion is seen: less where there was nothing that could have changed."""
    return price if pair.is_present(index) else price + float(np.log(APPEARS))


def _ended(found: Fit, changed: tuple[int, ...], others: Mapping[int, Fit]) -> Fit:
    """A change fitted to the end where it is comparable with the best of the others."""
    best = max((other.log_evidence for other in others.values()), default=-np.inf)
    return found.pair.fit(changed, found) if found.log_evidence > best - COMPARABLE_NATS else found


def _better(found: Mapping[int, Fit], fits: Mapping[int, Fit]) -> dict[int, Fit]:
    """Those that are of changes which have no fit so far, or explain more than theirs."""
    return {i: one for i, one in found.items() if i not in fits or one.log_evidence > fits[i].log_evidence}


def _ended_tendons(among: Mapping[int, Fit], chosen: tuple[int, ...], fits: Mapping[int, Fit]) -> dict[int, Fit]:
    """Softer tendons in the place of gain that some fits have lost, which are better than what there is of them."""
    better = _better(softer_tendons(among, chosen), fits)
    return {index: _ended(one, (*chosen, index), fits) for index, one in better.items()}


def _best_without(fit: Fit, fits: Mapping[int, Fit], chosen: tuple[int, ...]) -> tuple[float, dict[int, Fit]]:
    """(log evidence of the best that is found without a further change, each change where one without it has ended).

    What one adds to both sessions is no change, and from where it has come to the way down without it may be open.
    What is reached without it is reached with it as well.
    """
    none, found = fit.log_evidence, dict[int, Fit]()
    for index, one in fits.items():
        if one.log_evidence > fit.log_evidence:
            without = one.pair.fit(chosen, one, FIRST_ROUNDS)
            none = max(none, without.log_evidence)
            changed = frozenset((*chosen, index))
            found[index] = Fit(without.pair, without.point, without.rows, without.slopes, changed)
    return none, found


def _refitted(origin: Fit, changed: tuple[int, ...], index: int) -> list[Fit]:
    """A change after a step in roll-outs; an effect is put into the models of both sessions, by each of its laws."""
    pair, quantity = origin.pair, origin.pair.now.quantities[index]
    if quantity.is_parameter or index in pair.now.active:
        return [pair.fit(changed, origin, 1)]
    points = [origin.expected(changed)[0]]
    if quantity.grows:
        # to first order all else makes room for it, which what is not smooth need not do: begun where all else is, too
        alone = origin.point.copy()
        alone[[index, pair.count + index]] = 0.0, max(_alone(origin, pair.count + index, quantity.slab), quantity.spike)
        points.append(alone)
    begun = [Fit(pair, point, origin.rows, origin.slopes, origin.changed) for point in points]
    laws = [pair.with_quantity(index, law).with_active(pair.now.active | {index}) for law in quantity.laws()]
    return [law.fit(changed, one, 1) for law in laws for one in begun]


def _alone(origin: Fit, place: int, sigma: float) -> float:
    """How much of a change there would be if all else stayed where it is, to first order."""
    column = origin.slopes[:, place]
    return float(origin.point[place] - column @ origin.rows / (column @ column + 1.0 / sigma**2))


def _seen_from(fit: Fit, price: float) -> dict[int, float]:
    """By quantity the change of z from which its probability would have been SEEN, had nothing else changed."""
    found, least = {}, 0.5 * fit.by_chance[1]
    spikes = fit.pair.sigmas(())[fit.pair.count :]
    for index, quantity in enumerate(fit.pair.now.quantities):
        if quantity.wears:
            variance = fit.said_of(index)[1]
            spike, slab = variance + spikes[index] ** 2, variance + quantity.slab**2
            asked = float(np.log(SEEN / (1.0 - SEEN))) - _odds_before(fit.pair, index, price)
            asked = asked if fit.pair.is_present(index) else max(asked, least)
            asked += 0.5 * float(np.log(slab / spike)) if np.isfinite(variance) else np.inf
            found[index] = float(np.sqrt(2.0 * asked / (1.0 / spike - 1.0 / slab))) if np.isfinite(asked) else np.inf
    return found


def _left(fit: Fit) -> float:
    """Mean square of the later session's rows over the earlier one's, or over its noise where there is none."""
    before, now = fit.by_session
    later = float((now**2).mean())
    earlier = float((before**2).mean()) if len(before) else later
    return later / max(earlier, 1e-30)
