"""The search of one part: one effect after another, and from another beginning where that does not explain it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twin_daemon.diagnosis.candidates import candidate
from twin_daemon.diagnosis.conclude import Accepted, Outcome
from twin_daemon.diagnosis.far_off import beyond_any_hand, deviating, needed
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.limits import fitted_at
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.rivals import swap_rivals, without_idle
from twin_daemon.diagnosis.screening import AskedBefore
from twin_daemon.diagnosis.selection import next_effect
from twin_daemon.diagnosis.thresholds import (
    ADEQUATE_FLOORS,
    COMPARABLE,
    DEVIATING_SIGMA,
    FINALISTS,
    FULL_FIT_ROLLOUTS,
    MOST_OF_IT,
    REFINEMENT,
    RELATIVE_ERROR,
)
from twin_daemon.diagnosis.validation import Validation, most_left
from twin_daemon.diagnosis.weighing import decisive, weight_of
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.partition import Reduced
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime
from twin_daemon.simulation.terms import EffectTerm


def begun_outcome(reduced: Reduced, part: PartFit) -> Outcome:
    """What a group says before any effect was looked for."""
    worst = float(part.times_floor.max())
    return Outcome(reduced.name, part.joints, worst, deviating(part), part.moved)


@dataclass
class Progress:
    """How far the search of a part has come: its outcome so far, and the part with what was found.

    `left` (k,) are the floors that it leaves of the fitted motion, `enough` says that a right law leaves no less, and
    `ended` that nothing asks for a further effect, or none helps. `declined` is what helped and only bends a law.
    """

    outcome: Outcome
    part: PartFit
    validation: Validation
    left: np.ndarray
    enough: bool = False
    ended: bool = False
    declined: Accepted | None = None


@dataclass(frozen=True)
class PartSearch:
    """The search of one part for at most so many effects; `before` is what was asked of some of its joints alone.

    `late` says that commands come later there than at others, and `begins` is the first effect where that is known:
    of a shared cause, or of some of the joints `alone`, with all that it could not be told from there.
    """

    part: PartFit
    reduced: Reduced
    seed: int
    say: Say
    most_effects: int
    before: AskedBefore | None = None
    late: bool = False
    begins: EffectTerm | None = None
    alone: Accepted | None = None

    @cached_property
    def validation(self) -> Validation:
        """Of the part before any effect was found."""
        return Validation(self.part, self.reduced.holdout, seed=self.seed)

    @cached_property
    def _most_left(self) -> np.ndarray:
        """(k,) floors that a right law may leave of the fitted motion."""
        return most_left(self.part, self.part.times_floor)

    def begun(self) -> Progress:
        """The search up to its first effect."""
        return self._further(self._nothing_yet(), self._first(), 1)

    def _first(self) -> Accepted | None:
        """The effect that is known to be the first, fitted beside the part's nuisances; None where none is, or fits."""
        part, term = self.part, self.begins
        if term is None:
            return None
        hypothesis = candidate(LIBRARY[term.effect], term.target, part.twin, term.target)
        fit = fitted_at(part, hypothesis, term.values, {})
        judged, bar = self.validation.judge(fit), decisive(fit)
        if not judged.passes:
            return None
        found = Accepted(part, fit, judged, weighed={hypothesis.name: weight_of(part, fit, bar)}, decisive_nats=bar)
        if self.alone is None:
            return found
        moved = found.weighed[hypothesis.name] - self.alone.weighed[hypothesis.name]
        weighed = {name: nats + moved for name, nats in self.alone.weighed.items()}
        return replace(found, weighed=weighed, rivals=self.alone.rivals)

    def outcome(self, begun: Progress | None = None) -> Outcome:
        """What the part lacks: one effect after another; where that leaves too much, from another beginning as well.

        What two causes do together may look most like a third: play in a servo that often saturates passes for dry
        friction, and beside dry friction neither of the two has anything left to explain.
        """
        part = self.part
        progress = self._further(begun or self.begun(), None, self.most_effects)
        found, left = progress.outcome, progress.left
        # what takes less than a second effect has to is no first one
        most = (1.0 - REFINEMENT) * part.base.cost
        begins = [one for one in found.others if one.hypothesis.name not in found.names and one.fit.cost < most]
        begins = begins[:FINALISTS]
        # all that was accepted has one fit; of single beginnings the first is the best
        best = found.accepted or begins
        if found.unfinished or self.most_effects < 2 or not best:
            return found
        against, may_leave = best[0].fit, np.full_like(left, np.inf)
        if found.explains:
            if (RELATIVE_ERROR * left < 1.0).all():
                return found
            # it may be the form of its law that leaves much: only what leaves a small part of that is another answer
            may_leave = np.maximum(ADEQUATE_FLOORS, RELATIVE_ERROR * left)
            begins = [*found.accepted[:1], *(one for one in begins if one.fit.cost < COMPARABLE * against.cost)]
        reached = {one.hypothesis.name: against for one in found.accepted[:1]}
        for beginning in begins:
            named = beginning.hypothesis.name
            self.say(f"  once more, with {named} first")
            # beside the one effect that there is it is known already what helps
            known = progress.declined if found.names == {beginning.hypothesis.name} else None
            other = self._further(
                self._nothing_yet(), beginning, self.most_effects, against=against, may_leave=may_leave, known=known
            )
            other.outcome.tried = [*found.tried, *other.outcome.tried]
            end = other.outcome.accepted
            # beside what was found the beginning may as well not be there: what took its place has come that far
            reached[named] = end[-1].fit if named in other.outcome.names else beginning.fit
            better = part.evidence_nats(end[-1].fit) > part.evidence_nats(against) + decisive(against)
            if better and other.outcome.explains and (other.left <= may_leave).all():
                first = end[0]
                bar = decisive(first.fit)
                reached[first.hypothesis.name] = end[-1].fit
                # each beginning is worth what it has come to with what was found beside it
                weighed = {**first.weighed, **{name: weight_of(part, fit, bar) for name, fit in reached.items()}}
                end[0] = replace(first, weighed=weighed, decisive_nats=bar)
                return other.outcome
            found.tried, found.unfinished = other.outcome.tried, other.outcome.unfinished
            if found.unfinished:
                break
        return found

    def questioned(self, better: Fit) -> PartSearch | None:
        """The search of the same part, its nuisances from where a fit has them; None where they end hardly lower."""
        part = PartFit(self.part.twin, self.part.recordings, self.part.joints, after=better)
        lower = part.base.cost < self.part.base.cost - 2.0 * decisive(self.part.base)
        return replace(self, part=part) if lower else None

    def as_it_is(self) -> Outcome:
        """What the part says without any effect."""
        outcome = begun_outcome(self.reduced, self.part)
        outcome.left = self.validation.judge(self.part.base).adequacy
        outcome.within_floor = self.part.within_floor and not outcome.deviating and outcome.left <= 1.0
        return outcome

    def _nothing_yet(self) -> Progress:
        outcome = replace(self.as_it_is(), within_floor=False)
        return Progress(outcome, self.part, self.validation, self.part.times_floor)

    def _further(
        self,
        progress: Progress,
        step: Accepted | None,
        most_effects: int,
        *,
        against: Fit | None = None,
        may_leave: float | np.ndarray = np.inf,
        known: Accepted | None = None,
    ) -> Progress:
        """More effects until the part is at the floor, or none helps, or it has so many.

        With the first one given, if there is a `step`, and the next one where it is `known`. What is to stand `against`
        another fit of the part is given up where it does not promise to leave much less, and has to leave no more than
        it `may_leave` (k,) floors.
        """
        outcome, gone = progress.outcome, set[str]()
        try:
            while not progress.ended and len(outcome.accepted) < most_effects:
                if step is None and known is not None:
                    step, known = known if against and known.fit.cost <= MOST_OF_IT * against.cost else None, None
                elif step is None and (takes := _least_taken(self.part, progress)) < 1.0:
                    step = next_effect(
                        progress.part,
                        progress.validation,
                        self.say,
                        outcome,
                        against=against,
                        takes=takes,
                        before=None if outcome.accepted else self.before,
                        late=self.late and not outcome.accepted,
                    )
                # what has given way to others is no further effect beside them
                if step is None or step.hypothesis.name in gone or _is_refinement(self.part, progress, step.fit):
                    progress.declined, progress.ended = step, True
                    break
                before = {*outcome.names, step.hypothesis.name}
                part, validation, left = self._with(step, outcome, progress.validation)
                gone |= before - outcome.names
                enough = outcome.left <= 1.0 and bool((left <= may_leave).all())
                # a nuisance that is far off may be another effect at work
                progress = Progress(outcome, part, validation, left, enough, ended=enough and not outcome.deviating)
                step = None
            if outcome.accepted:
                outcome.deviating = needed(progress.part, self._most_left)
        except OutOfTime:
            outcome.unfinished = progress.ended = True
        return progress

    def _with(self, step: Accepted, outcome: Outcome, validation: Validation) -> tuple[PartFit, Validation, np.ndarray]:
        """(the part, its validation, (k,) floors left) with one more effect, which `outcome` then has accepted."""
        first = self.part
        outcome.accepted.append(step)
        outcome.left = step.judged.adequacy
        if len(outcome.accepted) > 1:
            joint = first.together([found.fit for found in outcome.accepted], FULL_FIT_ROLLOUTS)
            outcome.accepted = [replace(a, fit=fit) for a, fit in zip(outcome.accepted, joint, strict=True)]
            outcome.accepted = swap_rivals(first, outcome.accepted, FULL_FIT_ROLLOUTS)
            outcome.accepted, idle = without_idle(first, self.validation, outcome.accepted, FULL_FIT_ROLLOUTS)
            outcome.tried += idle
        fits = [found.fit for found in outcome.accepted]
        terms = first.twin.terms
        for found in outcome.accepted:
            terms = terms.with_effect(found.term)
        part = PartFit(first.twin.changed(terms), first.recordings, first.joints, after=fits[-1], found=fits)
        # beside the effect the nuisances have gone back to where they belong: judged once more as it stands
        validation = Validation(part, self.reduced.holdout, seed=self.seed, first=validation)
        held_out = outcome.left = min(outcome.left, validation.judge(part.base).adequacy)
        left = np.minimum(part.times_floor, fits[-1].problem.times_floor(fits[-1].point))
        fitted = float((left / self._most_left).max())
        if fitted > 1.0:
            # motion that hardly shows what is missing is predicted well by any law
            outcome.left = max(held_out, fitted)
        outcome.deviating, outcome.moved = deviating(part), part.moved
        named = ", ".join(found.hypothesis.name for found in outcome.accepted)
        of_allowed = f"of what a right model may leave {fitted:.1f} times fitted, {held_out:.1f} held out"
        self.say(f"  with {named}: {part.base.chi_square:.1f} times the floor; {of_allowed}")
        return part, validation, left


def _is_refinement(first: PartFit, progress: Progress, fit: Fit) -> bool:
    """Whether a further effect only bends the law of one that has been found at the same place.

    A second cause takes a part of the first error away, or most of what the first has left, or brings a nuisance back
    that has to be further off than any plausible hand without it. Where the first is enough already but for a
    nuisance that is somewhat far off, only an effect at another place is a second cause.
    """
    part, outcome = progress.part, progress.outcome
    joints = _judged_joints(part, fit)
    if not any(joints & _judged_joints(earlier.part, earlier.fit) for earlier in outcome.accepted):
        return False
    forced = _forced(outcome)
    if any(abs(fit.deviations.get(name, 0.0)) < DEVIATING_SIGMA for name in forced):
        return False
    if progress.enough and not forced:
        return True
    return part.base.cost - fit.cost < _share_of_a_cause(first, part) * part.base.cost


def _least_taken(first: PartFit, progress: Progress) -> float:
    """Share of the cost below which a further effect would only bend the law of one that has been found; 1: any would.

    It is what `_is_refinement` holds against it, of a part that lacks nothing but at the joints of those found.
    """
    part, outcome = progress.part, progress.outcome
    if not outcome.accepted or _forced(outcome):
        return 0.0
    named = {joint for earlier in outcome.accepted for joint in _judged_joints(earlier.part, earlier.fit)}
    if any(not (part.group_of(joint) or set()) & named for joint in part.suspects):
        return 0.0
    return 1.0 if progress.enough else _share_of_a_cause(first, part)


def _share_of_a_cause(first: PartFit, part: PartFit) -> float:
    """Of what is left: a part of the first error, or most of what the first effects have left."""
    return min(REFINEMENT * first.base.cost / part.base.cost, MOST_OF_IT)


def _forced(outcome: Outcome) -> list[str]:
    """Nuisances that no plausible hand has, and that a further effect may bring back.

    Where more than twice is left of what a right model leaves, that alone explains nothing: a second cause takes half.
    """
    nearly = outcome.left <= 1.0 / MOST_OF_IT
    return [name for name, _ in beyond_any_hand(outcome.deviating)] if nearly else []


def _judged_joints(part: PartFit, fit: Fit) -> set[str]:
    """The joints that an effect acts on; for the whole hand all of the part's."""
    group = part.group_of(fit.hypothesis.target) if fit.hypothesis else None
    return set(part.joints) if group is None else set(group)
