"""The search of one part: one effect after another, and from another beginning where that does not explain it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from twin_daemon.diagnosis.conclude import Accepted, Outcome, forced_nuisances
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.selection import Say, decisive, next_effect, swap_rivals
from twin_daemon.diagnosis.thresholds import DEVIATING_SIGMA, FULL_FIT_ROLLOUTS, MOST_OF_IT, REFINEMENT
from twin_daemon.diagnosis.validation import Validation, most_left
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.variables import EffectVariable
from twin_daemon.executor import OutOfTime, TimeLimit


def begun_outcome(reduced: Reduced, part: PartFit) -> Outcome:
    """What a group says before any effect was looked for."""
    worst = float(part.times_floor.max())
    return Outcome(reduced.name, part.joints, worst, deviating(part), part.moved)


def deviating(part: PartFit) -> dict[str, float]:
    """The nuisances that are too far from their priors to be nuisances, in sigma."""
    values = {variable.name for variable in part.variables if isinstance(variable, EffectVariable)}
    deviations = part.base.deviations.items()
    return {name: sigma for name, sigma in deviations if name not in values and abs(sigma) > DEVIATING_SIGMA}


@dataclass(frozen=True)
class PartSearch:
    """The search of one part for at most so many effects."""

    part: PartFit
    reduced: Reduced
    seed: int
    say: Say
    most_effects: int
    limit: TimeLimit

    @cached_property
    def validation(self) -> Validation:
        """Of the part before any effect was found."""
        return Validation(self.part, self.reduced.holdout, seed=self.seed)

    @cached_property
    def _most_left(self) -> np.ndarray:
        """(k,) floors that a right law may leave of the fitted motion."""
        return most_left(self.part, self.part.times_floor)

    def outcome(self) -> Outcome:
        """What the part lacks: one effect after another; where that explains too little, from another beginning too.

        What two causes do together may look most like a third: play in a servo that often saturates passes for dry
        friction, and beside dry friction neither of the two has anything left to explain.
        """
        found = self._one_after_another(None)
        other_beginnings = [one for one in found.others if one.hypothesis.name not in found.names]
        if _explains(found) or found.unfinished or self.most_effects < 2 or not other_beginnings:
            return found
        part = self.part
        last = (found.accepted or other_beginnings)[-1].fit
        reached = {one.hypothesis.name: part.evidence_nats(last) for one in found.accepted[:1]}
        for begun in other_beginnings:
            self.say(f"  once more, with {begun.hypothesis.name} first")
            other = self._one_after_another(begun, against=last)
            other.tried = [*found.tried, *other.tried]
            reached[begun.hypothesis.name] = part.evidence_nats(other.accepted[-1].fit)
            if _explains(other) and reached[begun.hypothesis.name] > part.evidence_nats(last) + decisive(last):
                first = other.accepted[0]
                # each beginning is worth what it has come to with what was found beside it
                weighed = {**first.weighed, **reached}
                other.accepted[0] = replace(first, weighed=weighed, decisive_nats=decisive(first.fit))
                return other
            found.tried, found.unfinished = other.tried, other.unfinished
            if found.unfinished:
                break
        return found

    def _one_after_another(self, begun: Accepted | None, *, against: Fit | None = None) -> Outcome:
        """Effects until the part is at the floor, or none helps; with the first one given, if it has `begun`.

        What is to stand `against` another fit of the part is given up where it does not promise to leave much less.
        """
        outcome = begun_outcome(self.reduced, self.part)
        part, validation, step = self.part, self.validation, begun
        outcome.left = validation.judge(part.base).adequacy
        for _ in range(self.most_effects):
            try:
                self.limit.check()
                if step is None:
                    step = next_effect(part, validation, self.say, outcome, self.limit, against=against)
            except OutOfTime:
                outcome.unfinished = True
                break
            if step is None or _is_refinement(self.part, part, step.fit, outcome):
                break
            part, validation = self._with(step, outcome, validation)
            if outcome.left <= 1.0 and not outcome.deviating:
                break  # a nuisance that is far off may be another effect at work
            step = None
        if outcome.accepted and forced_nuisances(outcome):
            outcome.deviating = _needed(part, self._most_left)
        return outcome

    def _with(self, step: Accepted, outcome: Outcome, validation: Validation) -> tuple[PartFit, Validation]:
        """The part and its validation with one more effect, which `outcome` has then among the accepted."""
        first = self.part
        outcome.accepted.append(step)
        outcome.left = step.judged.adequacy
        if len(outcome.accepted) > 1:
            joint = first.together([found.fit for found in outcome.accepted], FULL_FIT_ROLLOUTS)
            outcome.accepted = [replace(a, fit=fit) for a, fit in zip(outcome.accepted, joint, strict=True)]
            outcome.accepted = swap_rivals(first, outcome.accepted, FULL_FIT_ROLLOUTS)
        fits = [found.fit for found in outcome.accepted]
        terms = first.twin.terms
        for found in outcome.accepted:
            terms = terms.with_effect(found.hypothesis.term(found.fit.values))
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
        return part, validation


def _explains(outcome: Outcome) -> bool:
    """Whether what was found leaves what a right model does, with no nuisance further off than any plausible hand's."""
    return outcome.left <= 1.0 and not forced_nuisances(outcome)


def _needed(settled: PartFit, allowed: np.ndarray) -> dict[str, float]:
    """The nuisances that are far off, without those that need not be: laws differ in form, and these take that up.

    Brought back to where they may be, they leave no more than `allowed` (k,) floors, what a right law may.
    """
    found = deviating(settled)
    if (settled.problem.times_floor(settled.nearer(settled.base.point)) > allowed).any():
        return found
    moved = {variable.name for variable in settled.variables}
    return {name: sigma for name, sigma in found.items() if name not in moved}


def _is_refinement(first: PartFit, part: PartFit, fit: Fit, outcome: Outcome) -> bool:
    """Whether a further effect only bends the law of one that has been found at the same place.

    A second cause takes a part of the first error away, or most of what the first has left, or brings a nuisance back
    that has to be further off than any plausible hand without it. Where the first is right already but for a nuisance
    that is somewhat far off, only an effect at another place is a second cause.
    """
    joints = _judged_joints(part, fit)
    if not any(joints & _judged_joints(earlier.part, earlier.fit) for earlier in outcome.accepted):
        return False
    forced = [name for name, _ in forced_nuisances(outcome)]
    if any(abs(fit.deviations.get(name, 0.0)) < DEVIATING_SIGMA for name in forced):
        return False
    if outcome.left <= 1.0 and not forced:
        return True
    gained = part.base.cost - fit.cost
    return gained < REFINEMENT * first.base.cost and gained < MOST_OF_IT * part.base.cost


def _judged_joints(part: PartFit, fit: Fit) -> set[str]:
    """The joints that an effect acts on; for the whole hand all of the part's."""
    group = part.group_of(fit.hypothesis.target) if fit.hypothesis else None
    return set(part.joints) if group is None else set(group)
