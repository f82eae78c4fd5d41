"""The search of groups that feel each other: the worst first, and the others anew with what was found there."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeAlias

import numpy as np

from twin_daemon.diagnosis.as_fitted import looked_at_again, with_values
from twin_daemon.diagnosis.conclude import Outcome
from twin_daemon.diagnosis.everywhere import behind_all
from twin_daemon.diagnosis.far_off import beyond_any_hand, deviating, plainly_above
from twin_daemon.diagnosis.floor_check import above_floor, by_parameters
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.part_search import PartSearch, Progress, begun_outcome
from twin_daemon.diagnosis.screening import AskedBefore
from twin_daemon.diagnosis.shared import Shared
from twin_daemon.diagnosis.thresholds import GONE_FAR, LEAST_SHARE_OF_ERROR, MOST_OF_IT
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime
from twin_daemon.simulation.submodel import linked
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel


def units(twin: TwinModel, above: Sequence[tuple[Reduced, PartFit]]) -> list[list[tuple[Reduced, PartFit]]]:
    """The groups that are searched together: what happens at one joint is felt by those that carry it."""
    found = [[above[i] for i in members] for members in linked(twin, [r.joints for r, _ in above])]
    return sorted(found, key=lambda unit: -max(float(part.times_floor.max()) for _, part in unit))


_Asked: TypeAlias = tuple[Progress, list[tuple[Reduced, PartFit]]]
"""What the worst group was asked first, and the others that are above the floor beside that."""


@dataclass(frozen=True)
class UnitSearch:
    """The search for effects at groups above the floor. What they say is added to `outcomes` as it is known.

    `late` are joints at which commands come later than at others.
    """

    twin: TwinModel
    reduction: Reduction
    fitted: Mapping[str, float]
    seed: int
    say: Say
    most_effects: int
    outcomes: list[Outcome]
    touching: dict[str, tuple[str, ...]]
    late: frozenset[str] = frozenset()
    _asked: dict[tuple[str, ...], _Asked] = field(default_factory=dict, init=False)

    def search(self, unit: Sequence[tuple[Reduced, PartFit]], begins: EffectTerm | None = None) -> None:
        """Searches groups that feel each other one after another, the worst first (see `_how_bad`).

        What is found at the worst one often is all: its neighbours were told a wrong motion of it, or a wrong load. So
        they are looked at anew with it. Where no effect of one group explains it, all that are left are searched as
        one, unless it has nearly all of the error, as a cause at another joint shows there, too; so are they from the
        first effect on where that takes most of the error there and hardly any elsewhere, and those that feel an
        effect which is known to be the first there (`begins`). Of a search for no effect of a group each of them
        only says what it leaves; so do the others where one effect each is asked for and the first takes most away.
        """
        if not self.most_effects:
            self.outcomes.extend(begun_outcome(reduced, part) for reduced, part in unit)
            return
        if begins and len(unit) > 1 and any(begins.target in reduced.joints for reduced, _ in unit):
            self._begun_with(begins, unit)
            return
        twin, left = self.twin, list(unit)
        first: Outcome | None = None
        beside: EffectTerm | None = None
        while len(left) > 1:
            left.sort(key=_how_bad, reverse=True)
            reduced, part = left[0]
            search = self._search(part, reduced)
            begun, others = self._asked.pop(part.joints, None) or (search.begun(), None)
            others = self._beside(twin, begun, left)[-1] if others is None else others
            if _has_its_own(others, left[1:]):
                first = begun.outcome
                beside = first.accepted[-1].term
                break
            outcome = self._ended(twin, search, begun)
            most = self._one_each and _takes_most(outcome, left)
            enough = bool(outcome.accepted) and (outcome.explains or (self._one_each and outcome.left <= 1.0))
            if not enough and not most and not _is_nearly_all(left):
                first = outcome
                break
            self.outcomes.append(outcome)
            left = left[1:]
            if enough:
                twin = _with_found(twin, outcome)
                left = self._above(twin, [reduced for reduced, _ in left])
            if most or not enough:
                # what it lacks is not in the library, and may as well be what the others feel; or one effect takes most
                # of what all leave, beside which the others are another question, asked once all values are fitted
                self.outcomes.extend(begun_outcome(*other) for other in left)
                return
        if len(left) == 1:
            reduced, part = left[0]
            begun, _ = self._asked.pop(part.joints, (None, None))
            self.outcomes.append(self._ended(twin, self._search(part, reduced), begun))
        elif left and (found := self._together(twin, left, first, beside)) is not None:
            self.outcomes.append(found)

    def _begun_with(self, begins: EffectTerm, unit: Sequence[tuple[Reduced, PartFit]]) -> None:
        """Searches groups as one from a known first effect on, and otherwise where that does not explain them."""
        before = len(self.outcomes)
        together = self._together(self.twin, unit, None, begins)
        if together is None:
            return
        if together.unfinished or together.explains or (self._one_each and together.accepted):
            self.outcomes.append(together)
            return
        try:
            self.search(unit)
        except (KeyboardInterrupt, OutOfTime):
            self.outcomes[before:] = [replace(together, unfinished=True)]
            raise
        others = self.outcomes[before:]
        explained = all(one.explains or one.within_floor for one in others)
        if not explained and together.left <= max(one.left for one in others):
            self.outcomes[before:] = [replace(together, unfinished=any(one.unfinished for one in others))]

    def still_above(self, unit: list[tuple[Reduced, PartFit]]) -> list[tuple[Reduced, PartFit]]:
        """Those of some groups that are above the floor beside what was found at others.

        A group that leaves little more than right models do may have been told a wrong motion of a joint that lacks
        much. What is plainly above its floor, or is there by a value that is far off, or known to be late, stays.
        """
        found = [outcome for outcome in self.outcomes if outcome.accepted]
        little = not any(plainly_above(part) for _, part in unit)
        late = any(self.late & set(part.joints) for _, part in unit)
        if not (found and little and self.most_effects) or late:
            return unit
        twin = self.twin
        for outcome in found:
            twin = _with_found(twin, outcome)
        return self._above(twin, [reduced for reduced, _ in unit])

    def _together(
        self,
        twin: TwinModel,
        left: Sequence[tuple[Reduced, PartFit]],
        first: Outcome | None,
        begins: EffectTerm | None = None,
    ) -> Outcome | None:
        """What groups say that are searched as one, or what the `first` of them said where time is over before that."""
        try:
            whole = self.reduction.together(twin, [reduced for reduced, _ in left])
            if whole is None:
                self.touching[left[0][0].name] = tuple(name for reduced, _ in left for name in reduced.joints)
                return None
            reduced, part = look(whole)
        except OutOfTime:
            return first and replace(first, unfinished=True)
        asked = self._search(part, reduced, first and _asked(first))
        if not begins:
            found = self._ended(twin, asked)
        else:
            known = replace(asked, before=None, begins=begins, alone=first and first.accepted[-1])
            found = self._ended(twin, known)
            if first and not (found.explains or found.unfinished):
                again = self._ended(twin, asked)
                found = again if again.left < found.left else replace(found, unfinished=again.unfinished)
        return first if first and found.unfinished and not found.accepted else found

    @property
    def _one_each(self) -> bool:
        """Whether of each group no more is asked than what one effect leaves: all values are fitted together behind."""
        return self.most_effects == 1

    def _above(self, twin: TwinModel, groups: Sequence[Reduced]) -> list[tuple[Reduced, PartFit]]:
        """Those groups that are above the floor with what the twin now has."""
        reduction = self.reduction.following(self._as_fitted(twin))
        return above_floor(looked_at_again(twin, reduction, groups), self.outcomes, self.seed, self.say, seen=True)

    def _as_fitted(self, twin: TwinModel, *outcomes: Outcome) -> TwinModel:
        """A twin with effects, and what the nuisances have come to beside what was found, or where nothing was."""
        values = dict(self.fitted)
        for outcome in (*self.outcomes, *outcomes):
            for found in outcome.accepted:
                values.update(found.fit.moved)
                # what an effect speaks for is nominal beside it
                for name in found.hypothesis.speaks_for(twin) - found.fit.moved.keys():
                    values.pop(name, None)
        return with_values(twin, values)

    def behind_the_others(
        self, above: Sequence[tuple[Reduced, PartFit]], groups: int
    ) -> tuple[Shared | None, EffectTerm | None]:
        """(a cause that several of so many groups share beside what the worst of them has of its own, a load that may
        be one of several things wrong with all).

        What the worst one has of its own stood in its way, as it explains nothing of that.
        """
        if len(above) < 2 or self.most_effects < 2:
            return None, None
        worst, *others = sorted(above, key=_how_bad, reverse=True)
        begun = self._search(worst[1], worst[0]).begun()
        twin, reduction, left = self._beside(self.twin, begun, [worst, *others])
        self._asked[worst[1].joints] = begun, left
        found: Shared | None = None
        begins: EffectTerm | None = None
        with contextlib.suppress(OutOfTime):
            if _has_its_own(left, others):
                # the worst one shares it as well where it leaves more than its floor beside what it has of its own
                again = looked_at_again(twin, reduction, [worst[0]])
                left = [*(one for one in again if not one[1].within_floor), *left]
                if len(left) > 1:
                    found, begins = behind_all(twin, reduction, left, groups, self.seed, self.say)
            if not (found or begins) and len(others) > 1 and not (begun.ended or begun.outcome.explains):
                # one effect that stands in for both there leaves of the others what neither does
                found, begins = behind_all(self.twin, self.reduction, others, groups, self.seed, self.say)
        return found, begins

    def _beside(
        self, twin: TwinModel, begun: Progress, groups: Sequence[tuple[Reduced, PartFit]]
    ) -> tuple[TwinModel, Reduction, list[tuple[Reduced, PartFit]]]:
        """(a twin with the first effect of the worst group, the robot moving so, the others that are above the floor).

        No others where that effect takes too little of the error, or is all that there is to find.
        """
        found, (worst, *others) = begun.outcome, groups
        if self.most_effects < 2 or begun.ended or found.explains or not found.accepted:
            return twin, self.reduction, []
        if found.accepted[-1].fit.cost > (1.0 - MOST_OF_IT) * worst[1].base.cost:
            return twin, self.reduction, []
        with_it = _with_found(twin, found)
        reduction = self.reduction.following(self._as_fitted(with_it, found))
        try:
            again = looked_at_again(with_it, reduction, [reduced for reduced, _ in others])
        except OutOfTime:
            again = []
        return with_it, reduction, [one for one in again if not one[1].within_floor]

    def _search(self, part: PartFit, reduced: Reduced, before: AskedBefore | None = None) -> PartSearch:
        late = bool(self.late & set(part.joints))
        return PartSearch(part, reduced, self.seed, self.say, self.most_effects, before, late)

    def _ended(self, twin: TwinModel, search: PartSearch, begun: Progress | None = None) -> Outcome:
        """What a search comes to, from its first effect on where that is known."""
        part, reduced = search.part, search.reduced
        begun = begun or search.begun()
        try:
            nearer = self._nearer(twin, begun, reduced)
            if nearer is None:
                outcome = search.outcome(begun)
            else:
                self.say("  once more, the whole robot moving as what was found says")
                search = replace(search, part=nearer[1], reduced=nearer[0])
                outcome = search.outcome()
            nothing = not (outcome.accepted or outcome.unfinished)
            if nothing and outcome.neutral and (again := search.questioned(outcome.neutral)):
                self.say("  once more, as what is uncertain was not at its best without an effect")
                search, part = again, again.part
                outcome = search.as_it_is()
                outcome = outcome if outcome.within_floor else search.outcome()
            sound = part.within_floor and not (outcome.accepted or outcome.deviating or outcome.unfinished)
            if sound and outcome.left > 1.0:
                # it was looked at again for what the fitted motion leaves, and nothing takes that away
                outcome.within_floor = by_parameters(reduced, search.validation, self.seed)
        except OutOfTime:
            begun.outcome.unfinished = True
            return begun.outcome
        return outcome

    def _nearer(self, twin: TwinModel, begun: Progress, reduced: Reduced) -> tuple[Reduced, PartFit] | None:
        """A part on the motion that follows from its first effect, if that is not all and leaves less there; else None.

        The measured motion of a joint that lacks much was smoothed by a wrong prediction: what its neighbours do to it
        came out wrong, and no law explains that.
        """
        first = begun.outcome
        if begun.ended or self._one_each or not (first.accepted and self.reduction.carries):
            return None
        reduction = self.reduction.following(self._as_fitted(_with_found(twin, first), first))
        again = reduction.together(twin, [reduced])
        if again is None:
            return None
        terms = _with_found(again.twin, first)
        fits = [found.fit for found in first.accepted]
        beside = PartFit(terms, again.train, again.joints, after=fits[-1], found=fits)
        return look(again) if beside.base.cost < GONE_FAR * begun.part.base.cost else None


def _how_bad(group: tuple[Reduced, PartFit]) -> float:
    """How many floors a group leaves: the worst one is searched first.

    One that is at its floor by a value that no hand has counts with what it leaves without that: until it is said, its
    neighbours are told a wrong motion.
    """
    _, part = group
    by_a_value = part.within_floor and bool(beyond_any_hand(deviating(part)))
    return float((part.times_plausible_floor if by_a_value else part.times_floor).max())


def _has_its_own(again: Sequence[tuple[Reduced, PartFit]], before: Sequence[tuple[Reduced, PartFit]]) -> bool:
    """Whether a group that was looked at again keeps most of what it left before beyond its floor."""
    left = {part.joints: float((part.times_floor - 1.0).max()) for _, part in before}
    return any(float((part.times_floor - 1.0).max()) > MOST_OF_IT * left.get(part.joints, np.inf) for _, part in again)


def _is_nearly_all(groups: Sequence[tuple[Reduced, PartFit]]) -> bool:
    """Whether of several groups the first has nearly all of the error, in floors and as torque at its servo.

    What another one lacks, a load at its link for one, is not seen less there for a servo that is stiffer.
    """
    floors = [float((part.times_floor - 1.0).max()) for _, part in groups]
    torques = [
        max(
            (times - 1.0) * floor * part.twin.scale(joint).kp ** 2
            for joint, times, floor in zip(part.joints, part.times_floor, part.floor, strict=True)
        )
        for _, part in groups
    ]
    return all(other < LEAST_SHARE_OF_ERROR * worst for worst, *rest in (floors, torques) for other in rest)


def _takes_most(outcome: Outcome, groups: Sequence[tuple[Reduced, PartFit]]) -> bool:
    """Whether what was found at one of several groups takes most of what all of them leave away."""
    gained = sum(found.part.base.cost - found.fit.cost for found in outcome.accepted)
    return gained > MOST_OF_IT * sum(part.base.cost for _, part in groups)


def _asked(outcome: Outcome) -> AskedBefore | None:
    """What the search of a part says of its joints to one of several parts; None where nothing helped there."""
    named = {one.hypothesis.name: one.fit for one in (*outcome.others, *outcome.accepted)}
    return AskedBefore(frozenset(outcome.joints), tuple(named.values())) if named else None


def _with_found(twin: TwinModel, outcome: Outcome) -> TwinModel:
    """A twin with the effects that were found at a part."""
    terms = twin.terms
    for found in outcome.accepted:
        terms = terms.with_effect(found.term)
    return twin.changed(terms)
