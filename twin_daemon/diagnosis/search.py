"""The diagnosis: part by part, from the residual to a named cause, or to the plain word that there is none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from twin_daemon.diagnosis.conclude import Outcome, conclude, forced_nuisances, nothing_moves
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.power import undetectable
from twin_daemon.diagnosis.selection import Say, next_effect, swap_rivals
from twin_daemon.diagnosis.thresholds import (
    DEVIATING_SIGMA,
    FLOOR_CHI_SQUARE,
    FULL_FIT_ROLLOUTS,
    MOST_EFFECTS,
    MOST_OF_IT,
    REFINEMENT,
)
from twin_daemon.diagnosis.validation import Validation
from twin_daemon.diagnosis.verdict import Diagnosis
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.variables import EffectVariable
from twin_daemon.executor import OutOfTime, TimeLimit, concurrently
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.twin import TwinModel


def diagnose(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    stream: Say | None = None,
    most_effects: int = MOST_EFFECTS,
    limit: TimeLimit | None = None,
) -> Diagnosis:
    """Which physical effects the twin lacks, on the evidence of `train`, validated by `holdout`.

    Ctrl-C and the end of the time limit end the search; what has been found until then is in the answer.
    """
    limit = limit or TimeLimit()
    say = stream or (lambda _: None)
    moving = [name for name in moving_joints(train) if not joints or name in joints]
    if not moving:
        return nothing_moves(joints)
    reduction = Reduction(twin, train, holdout)
    outcomes: list[Outcome] = []
    touching: list[str] = []
    interrupted = False
    accepted_terms = twin.terms
    try:
        chosen = [(p, [n for n in moving if n in p.joints]) for p in parts(twin)]
        reduced_parts = [(p.name, reduction.of(twin, p, own)) for p, own in chosen if own]
        touching = [name for name, reduced in reduced_parts if reduced is None]
        looked_at = concurrently(_look, [reduced for _, reduced in reduced_parts if reduced is not None])
        looked_at.sort(key=lambda item: -item[1].base.chi_square)
        for reduced, fit in looked_at:
            if accepted_terms is not twin.terms:
                # an effect of the whole hand has been found in another part: look at this one with it
                part = next(p for p in parts(twin) if p.name == reduced.name)
                again = reduction.of(twin.changed(accepted_terms), part, reduced.joints)
                assert again is not None  # as clear of contacts as before
                reduced, fit = _look(again)
            seen = any(o.within_floor and not o.undetectable for o in outcomes)
            outcome = _search(fit, reduced, seed, say, most_effects, limit, seen=seen)
            outcomes.append(outcome)
            for found in outcome.accepted:
                if found.hypothesis.target == "hand":
                    accepted_terms = accepted_terms.with_effect(found.hypothesis.term(found.fit.values))
    except (KeyboardInterrupt, OutOfTime):
        interrupted = True
    return conclude(twin, train, outcomes, touching, interrupted)


def _look(reduced: Reduced) -> tuple[Reduced, PartFit]:
    return reduced, PartFit(reduced.twin, reduced.train, reduced.joints)


def _search(
    part: PartFit, reduced: Reduced, seed: int, say: Say, most_effects: int, limit: TimeLimit, *, seen: bool = False
) -> Outcome:
    """`seen` says that another part has moved richly enough for the hand to be called sound."""
    deviating = _deviating(part)
    outcome = Outcome(reduced.name, part.joints, part.base.chi_square, deviating)
    validation = Validation(part, reduced.holdout, seed=seed)
    outcome.left = validation.judge(part.base).adequacy
    say(
        f"{reduced.name}: {part.base.chi_square:.1f} times the floor with the nominal parameters' uncertainty taken out"
    )
    if part.base.chi_square <= FLOOR_CHI_SQUARE and not deviating:
        outcome.undetectable = undetectable(part) if outcome.left > 1.0 or not seen else []
        # what only held-out motion shows is looked for where the other motion can show it
        if outcome.left <= 1.0 or outcome.undetectable or _by_parameters(reduced, validation, seed):
            outcome.within_floor = True
            return outcome
    first = part
    for _ in range(most_effects):
        step = next_effect(part, validation, say, outcome, limit)
        if step is None:
            break
        if _is_refinement(first, part, step.fit, outcome):
            break
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
        settled = PartFit(first.twin.changed(terms), part.recordings, part.joints, after=fits[-1], found=fits)
        # beside the effect the nuisances have gone back to where they belong: judged once more as it stands
        validation = Validation(settled, reduced.holdout, seed=seed, first=validation)
        outcome.left = min(outcome.left, validation.judge(settled.base).adequacy)
        outcome.deviating = _deviating(settled)
        named = ", ".join(found.hypothesis.name for found in outcome.accepted)
        say(f"  with {named}: {settled.base.chi_square:.1f} times the floor, {outcome.left:.1f} held out")
        if outcome.left <= 1.0 and not outcome.deviating:
            break  # a nuisance that is far off may be another effect at work
        part = settled
    return outcome


def _by_parameters(reduced: Reduced, validation: Validation, seed: int) -> bool:
    """Whether parameters within their uncertainty explain the held-out motion as well: fitted to the end, or to all.

    A short recording leaves them loose: what they then get wrong on other motion is no effect.
    """
    for recordings in (reduced.train, [*reduced.train, *reduced.holdout]):
        part = PartFit(reduced.twin, recordings, reduced.joints, thoroughly=True)
        left = Validation(part, reduced.holdout, seed=seed, first=validation).judge(part.base).adequacy
        if part.base.chi_square <= FLOOR_CHI_SQUARE and left <= 1.0 and not _deviating(part):
            return True
    return False


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


def _deviating(part: PartFit) -> dict[str, float]:
    """The nuisances that are too far from their priors to be nuisances, in sigma."""
    values = {variable.name for variable in part.variables if isinstance(variable, EffectVariable)}
    deviations = part.base.deviations.items()
    return {name: sigma for name, sigma in deviations if name not in values and abs(sigma) > DEVIATING_SIGMA}
