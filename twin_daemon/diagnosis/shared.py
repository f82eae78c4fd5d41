"""Causes that several groups of joints feel at once: a late bus, a weak supply, a tilted base, a load on a chain.

The causes that begin best are fitted, and the best of them counts where it brings the groups back to the floor. Where
none does, two loads at once may.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np

from twin_daemon.diagnosis.far_off import beyond_any_hand, deviating
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.probability import posterior
from twin_daemon.diagnosis.shared_cause import Cause, SharedCause
from twin_daemon.diagnosis.shared_check import passing
from twin_daemon.diagnosis.shared_fit import Begun, SharedFit
from twin_daemon.diagnosis.shared_pair import SharedPair
from twin_daemon.diagnosis.thresholds import (
    COMPARABLE,
    DECISIVE_NATS,
    MOST_OF_IT,
    REFINEMENT,
    SHARED_FINALISTS,
    SHARED_SHARES,
)
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.estimation.uncertainty import block_gain
from twin_daemon.executor import concurrently
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.terms import EffectTerm, Terms


@dataclass(frozen=True)
class Shared:
    """A cause that was accepted: its findings, one for each of its effects, its terms, and the groups with it.

    `posteriors` are the probabilities of each of its effects and of what the data could not tell from that.
    """

    findings: tuple[Finding, ...]
    posteriors: tuple[Mapping[str, float], ...]
    terms: Terms
    looked_at: list[tuple[Reduced, PartFit]]

    @property
    def finding(self) -> Finding:
        """The finding, or the first of two."""
        return self.findings[0]

    @property
    def one_of_several(self) -> bool:
        """Whether it is a load at a joint beside which some value has to be further off than any plausible hand's.

        That value stands in for a second effect, beside which the load is another one.
        """
        sure = self.finding.target not in (ROBOT, HAND) and not self.finding.confusable_with
        return sure and len(self.findings) == 1 and any(_is_forced(part) for _, part in self.looked_at)

    @property
    def forced(self) -> list[tuple[Reduced, PartFit]]:
        """Of a cause of the whole robot the groups that may have an effect of their own beside it."""
        return [one for one in self.looked_at if self.finding.target == ROBOT and _is_forced(one[1])]

    @property
    def settled(self) -> list[tuple[Reduced, PartFit]]:
        """The others."""
        return [one for one in self.looked_at if not (self.finding.target == ROBOT and _is_forced(one[1]))]


def _is_forced(part: PartFit) -> bool:
    """Whether some uncertain value has to be further off than any plausible hand's."""
    return bool(beyond_any_hand(deviating(part)))


def _least_cost(part: PartFit) -> float:
    """What a part's nuisances can bring its cost to, to first order: their fit ends where the floor is reached."""
    fit = part.base
    rows = fit.problem.residuals(fit.point[None])[0]
    least = rows + fit.slopes @ np.linalg.lstsq(fit.slopes, -rows, rcond=None)[0]
    return float(least @ least)


@dataclass(frozen=True)
class _Held:
    """A cause fitted to its end with the groups beside it, and what held-out motion says of each (see `passing`).

    `slopes` (m, q) are those of the rows of the search `there`; `helped` says whether it takes from each group.
    """

    found: Begun
    slopes: np.ndarray
    there: SharedSearch
    looked_at: list[tuple[Reduced, PartFit]]
    squares: list[tuple[np.ndarray, np.ndarray] | None]
    helped: bool

    @property
    def passes(self) -> bool:
        return None not in self.squares


class SharedSearch(SharedFit):
    """Looks for one cause behind what several groups show, or for two loads.

    `nearly` is the best load that leaves of all groups what a right law leaves and does not bring them to their floors:
    something else may be wrong at one of them.
    """

    nearly: EffectTerm | None = None
    _least = np.inf

    def _pairs(self, alone: Sequence[Begun], causes: Sequence[SharedCause]) -> list[list[Begun]]:
        """Two loads at once, fitted together: each of some that were fitted `alone` beside each of all.

        What is fitted alone does some of the other one's work, and beside that another place or kind of the other one
        may look best. So each of the best two is asked for again beside the other, as that is in the pair.
        """
        best: dict[frozenset[str], Begun] = {}
        before: Begun | None = None
        while alone:
            for one in alone:
                for fit in self._beside_each(one, causes, before.cost if before else np.inf):
                    best[fit.effects] = min(fit, best.get(fit.effects, fit), key=lambda one: one.cost)
            now = min(best.values(), key=lambda one: one.cost, default=before)
            if now is None or (before is not None and now.effects == before.effects):
                break
            before, alone = now, [self.at(part, now.cause.values_of(part, now.values)) for part in now.cause.parts]
        return [[fit] for fit in best.values()]

    def _beside_each(self, one: Begun, causes: Sequence[SharedCause], least: float) -> list[Begun]:
        """A load with each other one beside it, those fitted that begin best."""
        (first,) = one.cause.parts
        begun, fits = list[Begun](), list[Begun]()
        for cause in causes:
            if not cause.is_load or cause.name == first.name:
                continue
            pair = SharedPair((first, cause))
            lines = [partial(pair.along, one.values, start) for start in cause.directions(self._starts(cause))]
            every = [item for line in lines for item in self._projected(pair, line, one.rows)]
            if every:
                begun.append(min(every, key=lambda item: item.cost))
        for item in sorted(begun, key=lambda item: item.cost)[:SHARED_FINALISTS]:
            fits.append(self.fitted(item, COMPARABLE * min((fit.cost for fit in fits), default=least))[0])
        return fits

    def _may_be_loads(self, causes: Sequence[SharedCause]) -> bool:
        """Whether any loads together could help most groups, each group taking of each as much as serves it best.

        No group may keep most of what is above its floor: what is left of a right pair is what neighbours are told to
        move like by a twin without it.
        """
        light: list[tuple[Cause, dict[str, float]]] = []
        for cause in causes:
            if cause.is_load:
                starts = cause.directions(self._starts(cause))
                light += [(cause, cause.along(start, SHARED_SHARES[-1])) for start in starts]
        found = [one for one in concurrently(lambda item: self._at(*item), light) if one is not None]
        if not found:
            return False
        changes = np.column_stack([one.rows - self._nothing for one in found])
        both = zip(self._groups, self._split(changes), strict=True)
        left = np.concatenate([g.rows - change @ np.linalg.lstsq(change, g.rows, rcond=None)[0] for g, change in both])
        return self._share_helped(left) > 0.5 and self._share_helped(left, MOST_OF_IT) == 1.0

    def _held_to(self, settled: tuple[Begun, np.ndarray, Self], seed: int) -> _Held:
        found, slopes, there = settled
        looked_at = there.beside(found.cause, found.values)
        squares = passing(self._above, looked_at, seed)
        fitted = not any(part.nominal for _, part in self._above)
        if None in squares and fitted and not found.cause.is_load:
            # the others may move more like the robot as what is uncertain about each was fitted than as the cause says
            before = self.beside(found.cause, found.values)
            other = passing(self._above, before, seed)
            if other.count(None) < squares.count(None):
                looked_at, squares = before, other
        both = zip(self._above, looked_at, strict=True) if looked_at else ()
        helped = bool(looked_at) and all(new.base.cost < old.base.cost for (_, old), (_, new) in both)
        return _Held(found, slopes, there, looked_at, squares, helped)

    def best(
        self,
        causes: Sequence[SharedCause],
        seed: int,
        *,
        most_left: float = np.inf,
        known: Sequence[Sequence[Begun]] | None = None,
    ) -> Shared | None:
        """The cause that brings the groups back to the floor, on held-out motion too; None where none does.

        What leaves more than a share `most_left` of the cost beside the floor is not looked at any further. Where none
        does and all may be loads, two at once are asked for: of three groups that is cheaper than one each. `known`
        are causes in their forms as they were fitted to these groups and others: they begin there, and no other does.
        """
        finalists = self._finalists(self._begun(causes) if known is None else self._from(known))
        self._least = min((forms[0].cost for forms in finalists), default=np.inf)
        found = self._accepted(finalists, causes, seed, most_left)
        loads = sorted((forms[0] for forms in finalists if forms[0].cause.is_load), key=lambda one: one.cost)
        if found is None and len(self._above) > 2 and loads and self._may_be_loads(causes):
            # the best of each kind: where a load is shows beside the right other one
            best = {one.cause.parts[0].effect.key: one for one in reversed(loads)}
            found = self._accepted(self._pairs(list(best.values()), causes), (), seed, most_left)
        return found

    def nearly_as_good(self, causes: Sequence[SharedCause]) -> bool:
        """Whether one of some causes comes as near as what was looked for last (see `COMPARABLE`)."""
        return any(forms[0].cost <= COMPARABLE * self._least for forms in self._finalists(self._begun(causes)))

    def _begun(self, causes: Sequence[SharedCause]) -> list[list[Begun]]:
        return concurrently(lambda cause: self.begun(cause), causes)

    def _from(self, known: Sequence[Sequence[Begun]]) -> list[list[Begun]]:
        """Causes in their forms as they were fitted to other groups as well."""
        every = [[self._at(one.cause, one.values) for one in forms] for forms in known]
        return [[one for one in forms if one is not None] for forms in every]

    def _finalists(self, every: Sequence[list[Begun]]) -> list[list[Begun]]:
        """The causes that begin best, fitted, each in its forms."""
        begun = sorted((forms for forms in every if forms), key=lambda forms: forms[0].cost)
        if not begun:
            return []
        best, *others = begun[:SHARED_FINALISTS]
        first = self._in_its_forms(best)
        every = [first, *concurrently(lambda forms: self._in_its_forms(forms, COMPARABLE * first[0].cost), others)]
        best_fit = min((forms[0] for forms in every), key=lambda fit: fit.cost)
        if self._at_every_floor(best_fit):
            return every
        near = COMPARABLE * best_fit.cost
        return concurrently(lambda f: [self._in_detail(one) if one.cost <= near else one for one in f], every)

    def _in_its_forms(self, forms: Sequence[Begun], reach: float = np.inf) -> list[Begun]:
        """A cause fitted in each of its forms, the best first."""
        return sorted((self.fitted(one, reach)[0] for one in forms), key=lambda fit: fit.cost)

    def _most_promising(
        self, finalists: Sequence[Sequence[Begun]]
    ) -> tuple[Sequence[Begun], list[Begun], tuple[Begun, np.ndarray, Self] | None]:
        """(the best cause, in its forms; all of them as they are held against each other; it where it is settled).

        Of several that come as far it is the best once they are settled: far from where a cause has come to, what
        nuisances can do to first order does not say which of them is right. Where the best is at the floor these are
        the ones that are behind it by no more than that has changed, or than the data tell apart.
        """
        fits = [forms[0] for forms in finalists]
        best = min(range(len(fits)), key=lambda i: fits[i].cost)
        near = [i for i, fit in enumerate(fits) if fit.cost <= COMPARABLE * fits[best].cost and self._helps_most(fit)]
        if len(near) < 2 or len(fits[best].cause.parts) > 1:
            return finalists[best], fits, None
        settled: dict[int, tuple[Begun, np.ndarray, Self]] = {}
        if fits[best].cost <= FLOOR_CHI_SQUARE * self._floor_cost:
            settled[best] = self.settled(fits[best])
            reach = abs(settled[best][0].cost - fits[best].cost) + 2.0 * DECISIVE_NATS
            near = [i for i in near if fits[i].cost < fits[best].cost + reach]
        settled |= {i: self.settled(fits[i]) for i in near if i not in settled}
        best = min(settled, key=lambda i: settled[i][0].cost)
        fits = [settled[i][0] if i in settled else fit for i, fit in enumerate(fits)]
        return finalists[best], fits, settled[best]

    def _accepted(
        self, finalists: Sequence[Sequence[Begun]], causes: Sequence[SharedCause], seed: int, most_left: float
    ) -> Shared | None:
        if not finalists:
            return None
        forms, fits, settled = self._most_promising(finalists)
        best = forms[0]
        if best.cost > most_left * self._cost_without + self._floor_cost:
            return None
        if not self._helps_most(best):
            return None
        held = self._held_to(settled or self.settled(best), seed)
        if len(forms) > 1 and not held.passes and held.helped:
            # where joints differ in how much they have, its form shows only when each has its own share
            held = self._held_to(self.settled(forms[1]), seed)
        found, slopes, there = held.found, held.slopes, held.there
        cause, values = found.cause, found.values
        above, looked_at, squares = self._above, held.looked_at, held.squares
        if None in squares and cause.is_load:
            # a load ties the joints that carry it together, more than their measured motion can say of each other
            above = self.joined(self._twin)
            looked_at = there.joined(self._twin.changed(cause.terms(self._twin, values)))
            squares = passing(above, looked_at, seed)
            if None in squares and held.helped and len(cause.parts) == 1 and self._takes_all(found):
                self.nearly = cause.terms(self._twin, values).effects[-1]
        elif None in squares:
            right = [i for i, one in enumerate(squares) if one is not None]
            if held.helped and 2 * len(right) > len(squares) > 2:
                # what most have all may have, and some something of their own beside it
                return self.only(right).best(causes, seed, known=finalists)
        if not squares or None in squares:
            return None
        before, after = (np.concatenate(both) for both in zip(*filter(None, squares), strict=True))
        both = zip(above, looked_at, strict=True)
        if any(old.nominal for _, old in above):
            # over what the uncertain values could do instead, which nobody has fitted: on what was searched
            evidence = 0.5 * (self._cost_without - found.cost)
        else:
            by_group = [0.5 * (_least_cost(old) - _least_cost(new)) for (_, old), (_, new) in both]
            evidence = sum(by_group)
            # what some have, and others do better without, is theirs alone; where a load hangs all beneath it feel it,
            # and that it is a point is its form
            of_its_form = REFINEMENT * evidence if cause.is_load else 0.0
            if min(by_group) < -(DECISIVE_NATS + of_its_form):
                return None
        if evidence < DECISIVE_NATS:
            return None
        told = _told_apart(settled[0] if settled else best, fits, self._cost_without)
        joints = tuple(dict.fromkeys(joint for reduced, _ in self._above for joint in reduced.joints))
        estimates = there.estimates(found, slopes)
        moved = {name: value for _, part in looked_at for name, value in part.base.moved.items()}
        findings = tuple(
            Finding(
                effect=part.effect.key,
                target=part.target,
                joints=joints,
                parameters=cause.values_of(part, estimates),
                values=part.term(cause.values_of(part, values)).values,
                moved=moved,
                evidence_nats=evidence,
                holdout_mse_before_rad2=float(before.mean()),
                holdout_mse_after_rad2=float(after.mean()),
                holdout_gain=1.0 - float(after.mean() / max(before.mean(), 1e-30)),
                holdout_gain_ci95=block_gain(before, after, max(1, len(before) // 50), seed),
                confusable_with=ties,
                probability=shares[part.name],
                explanation=part.effect.story.explanation,
            )
            for part, (ties, shares) in zip(cause.parts, told, strict=True)
        )
        return Shared(findings, tuple(shares for _, shares in told), cause.terms(self._twin, values), looked_at)


def _told_apart(best: Begun, fits: Sequence[Begun], nothing: float) -> list[tuple[tuple[str, ...], dict[str, float]]]:
    """For each effect of a cause (what the data do not tell from it, the probabilities of it and of all others there).

    Of two effects at once one is held against what may be in its place beside the other. `nothing` is the cost without.
    """
    found = []
    for part in best.cause.parts:
        rest = best.effects - {part.name}
        places = {next(iter(one.effects - rest)): one for one in fits if rest <= one.effects}
        ties = [n for n, o in places.items() if o is not best and 0.5 * (o.cost - best.cost) < DECISIVE_NATS]
        shares = posterior({n: 0.5 * (nothing - o.cost) for n, o in places.items()}, DECISIVE_NATS)
        found.append((tuple(ties), shares))
    return found
