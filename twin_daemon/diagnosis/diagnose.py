"""The diagnosis: part by part, from the residual to a named cause, or to the plain word that there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.diagnosis.candidates import hypotheses
from twin_daemon.diagnosis.conclude import Accepted, Outcome, conclude, forced_nuisances, nothing_moves
from twin_daemon.diagnosis.exchange import exchanged
from twin_daemon.diagnosis.fit import Fit, Rough, Start
from twin_daemon.diagnosis.gate import Gate
from twin_daemon.diagnosis.intervals import stands_out
from twin_daemon.diagnosis.partfit import QUIET_CHI_SQUARE, SUSPECT_SIGMA, PartFit
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.verdict import Diagnosis, Trial
from twin_daemon.diagnosis.visible import DECISIVE_NATS, unseen
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.variables import EffectVariable
from twin_daemon.executor import OutOfTime, TimeLimit, concurrently
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.twin import TwinModel

STRAINED_SIGMA = 4.0
"""A nuisance this far from its prior is no nuisance: something moves it."""

REFINEMENT = 0.03
"""Of the first error: what a second effect at the same place has to take away, or most of what is left."""

MOST_OF_IT = 0.5
"""Of what is left: most of it."""

MOST_EFFECTS = 3
"""That a part of the hand is searched for."""

_LOOKED_AT = 15  # candidates from each point of the nuisances
_REFITTED = 5  # of them
_STARTS = 4
_ROUGH = 14  # roll-outs of every candidate's fit beside those of its derivatives
_FINALISTS = 3
_COMPARABLE = 4.0  # times the best cost: what is further off after a first fit is not fitted again
_FINE = 12  # more for the best of them
_ALIKE = 0.1  # of the best candidate's cost: laws that come this close are not told apart by their form

Stream = Callable[[str], None]
"""Called with one line whenever a candidate has been judged."""


def diagnose(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    stream: Stream | None = None,
    most_effects: int = MOST_EFFECTS,
    limit: TimeLimit | None = None,
) -> Diagnosis:
    """Which physical effects the twin lacks, on the evidence of `train`, gated by `holdout`.

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
            seen = any(o.quiet and not o.unseen for o in outcomes)
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
    part: PartFit, reduced: Reduced, seed: int, say: Stream, most_effects: int, limit: TimeLimit, *, seen: bool = False
) -> Outcome:
    """`seen` says that another part has moved richly enough for the hand to be called sound."""
    strained = _strained(part)
    outcome = Outcome(reduced.name, part.joints, part.base.chi_square, strained)
    gate = Gate(part, reduced.holdout, seed=seed)
    outcome.left = gate.judge(part.base).adequacy
    say(
        f"{reduced.name}: {part.base.chi_square:.1f} times the floor with the nominal parameters' uncertainty taken out"
    )
    if part.base.chi_square <= QUIET_CHI_SQUARE and not strained:
        outcome.unseen = unseen(part) if outcome.left > 1.0 or not seen else []
        # what only held-out motion shows is looked for where the other motion can show it
        if outcome.left <= 1.0 or outcome.unseen or _by_parameters(reduced, gate, seed):
            outcome.quiet = True
            return outcome
    first = part
    for _ in range(most_effects):
        step = _step(part, gate, say, outcome, limit)
        if step is None:
            break
        if _is_refinement(first, part, step.fit, outcome):
            break
        outcome.accepted.append(step)
        outcome.left = step.judged.adequacy
        if len(outcome.accepted) > 1:
            joint = first.together([found.fit for found in outcome.accepted], _FINE)
            outcome.accepted = [replace(a, fit=fit) for a, fit in zip(outcome.accepted, joint, strict=True)]
            outcome.accepted = exchanged(first, outcome.accepted, _FINE, _decisive)
        fits = [found.fit for found in outcome.accepted]
        terms = first.twin.terms
        for found in outcome.accepted:
            terms = terms.with_effect(found.hypothesis.term(found.fit.values))
        settled = PartFit(first.twin.changed(terms), part.recordings, part.joints, after=fits[-1], found=fits)
        # beside the effect the nuisances have gone back to where they belong: judged once more as it stands
        gate = Gate(settled, reduced.holdout, seed=seed, first=gate)
        outcome.left = min(outcome.left, gate.judge(settled.base).adequacy)
        outcome.strained = _strained(settled)
        named = ", ".join(found.hypothesis.name for found in outcome.accepted)
        say(f"  with {named}: {settled.base.chi_square:.1f} times the floor, {outcome.left:.1f} held out")
        if outcome.left <= 1.0 and not outcome.strained:
            break  # a nuisance that is far off may be another effect at work
        part = settled
    return outcome


def _by_parameters(reduced: Reduced, gate: Gate, seed: int) -> bool:
    """Whether parameters within their uncertainty explain the held-out motion as well: fitted to the end, or to all.

    A short recording leaves them loose: what they then get wrong on other motion is no effect.
    """
    for recordings in (reduced.train, [*reduced.train, *reduced.holdout]):
        part = PartFit(reduced.twin, recordings, reduced.joints, thoroughly=True)
        left = Gate(part, reduced.holdout, seed=seed, first=gate).judge(part.base).adequacy
        if part.base.chi_square <= QUIET_CHI_SQUARE and left <= 1.0 and not _strained(part):
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
    if any(abs(fit.strains.get(name, 0.0)) < STRAINED_SIGMA for name in forced):
        return False
    if outcome.left <= 1.0 and not forced:
        return True
    gained = part.base.cost - fit.cost
    return gained < REFINEMENT * first.base.cost and gained < MOST_OF_IT * part.base.cost


def _judged_joints(part: PartFit, fit: Fit) -> set[str]:
    """The joints that an effect acts on; for the whole hand all of the part's."""
    group = part.group_of(fit.hypothesis.target) if fit.hypothesis else None
    return set(part.joints) if group is None else set(group)


def _strained(part: PartFit) -> dict[str, float]:
    """The nuisances that are too far from their priors to be nuisances, in sigma."""
    values = {variable.name for variable in part.variables if isinstance(variable, EffectVariable)}
    strains = part.base.strains.items()
    return {name: sigma for name, sigma in strains if name not in values and abs(sigma) > STRAINED_SIGMA}


def _step(part: PartFit, gate: Gate, say: Stream, outcome: Outcome, limit: TimeLimit) -> Accepted | None:
    """One more effect for a part: the best candidate that passes the gate, and what it cannot be told from."""
    limit.check()
    screening = Screening(part)
    chosen = _shortlist(screening, part, outcome)
    limit.check()
    tried: dict[str, Rough] = {}
    for rough in concurrently(limit.checked(lambda entered: screening.roughly(entered, _ROUGH)), chosen):
        before = tried.get(rough.hypothesis.name)
        tried[rough.hypothesis.name] = rough if before is None or rough.cost < before.cost else before
    roughly = sorted(tried.values(), key=lambda rough: rough.cost)
    if not roughly:
        return None
    within = [rough for rough in roughly if rough.cost < _COMPARABLE * roughly[0].cost + screening.floor_cost]
    # where nuisances reach the floor, costs differ by less than a first fit is good for
    finalists = within[: 2 * _FINALISTS if part.base.chi_square <= QUIET_CHI_SQUARE else _FINALISTS]
    finalists += [r for r in within if r not in finalists and finalists[0].hypothesis.contains(r.hypothesis)]
    for rough in [r for r in roughly if r not in finalists]:
        gain = 0.5 * (screening.cost - rough.cost)
        behind = 0.5 * (rough.cost - roughly[0].cost)
        reason = f"explains less: {behind:.0f} nats behind {roughly[0].hypothesis.name}"
        outcome.tried.append(Trial(rough.hypothesis.effect.key, rough.hypothesis.target, gain, None, None, reason))
        say(f"  {rough.hypothesis.name}: {gain:.0f} nats, {behind:.0f} behind the best")
    fine = concurrently(limit.checked(lambda rough: part.finely(rough, _FINE)), finalists)
    fits = sorted(((part.evidence(fit), fit) for fit in fine), key=lambda item: -item[0])
    for evidence, fit in fits:
        say(f"  {_named(fit)}: evidence {evidence:.0f} nats, {fit.chi_square:.1f} times the floor")
    best: Accepted | None = None
    simpler: Accepted | None = None
    rivals: list[Accepted] = []
    best_evidence = 0.0
    for evidence, fit in fits:
        hypothesis = fit.hypothesis
        assert hypothesis is not None
        judged = gate.judge(fit)
        reason = None
        if evidence <= DECISIVE_NATS:
            reason = "adds less evidence than its parameters cost"
        elif not stands_out(fit):
            reason = "its value may as well be that of the model without it"
        elif not judged.passes:
            reason = f"does not help on held-out motion (gain {judged.gain:.0%}, interval reaches below 0)"
        elif best is None:
            best, best_evidence = Accepted(part, fit, judged), evidence
            continue
        elif simpler is None and judged.adequate and best.hypothesis.contains(hypothesis):
            simpler = Accepted(part, fit, judged)
            continue
        elif best_evidence - evidence < _decisive(best.fit) and (judged.adequate or not best.judged.adequate):
            rivals.append(Accepted(part, fit, judged))
            reason = "the data do not tell it from the best candidate"
        else:
            reason = f"explains less: {best_evidence - evidence:.0f} nats behind"
        mse = float(np.mean([(r**2).mean() for r in fit.problem.joint_residuals(fit.point[None])]))
        held = judged.mse_after
        outcome.tried.append(Trial(hypothesis.effect.key, hypothesis.target, evidence, mse, held, reason))
    if best is None:
        return None
    if simpler is not None:
        # both are right on held-out motion, and one is the other at a bound: the simpler is the answer
        return replace(simpler, rivals=(*rivals, best))
    return replace(best, rivals=tuple(rivals))


def _named(fit: Fit) -> str:
    return fit.hypothesis.name if fit.hypothesis else ""


def _decisive(best: Fit) -> float:
    """Nats by which another candidate has to be behind: more where the best is itself not down at the noise."""
    return max(DECISIVE_NATS, _ALIKE * 0.5 * best.cost)


def _worth_a_look(screening: Screening, screened: Sequence[Sequence[Start]], owners: set[str]) -> list[Start]:
    """The starts that are rolled out as they are: from each point of the nuisances, those of its best candidates.

    Where the nuisances fit best without it, the right effect may have little to add. So the points are not compared.
    """
    looked_at: list[Start] = []
    for anchor in dict.fromkeys(start.anchor for starts in screened for start in starts):
        worth = screening.left_at(anchor) - 2.0 * DECISIVE_NATS
        here = [[start for start in starts if start.anchor == anchor] for starts in screened]
        here = sorted((starts for starts in here if starts), key=lambda starts: starts[0].expected)
        for rank, starts in enumerate(here):
            own = starts[0].hypothesis.name in owners
            if own or (rank < _LOOKED_AT and starts[0].expected < worth):
                looked_at += starts[: _STARTS if own else 2]
    return looked_at


def _shortlist(screening: Screening, part: PartFit, outcome: Outcome) -> list[Rough]:
    """Where to start the fits that are worth one: the best start of each candidate by the cost that it has.

    What a nuisance stands in for is invisible beside it. Where nuisances alone reach the floor by straining, only
    effects at their joints are asked; elsewhere what they stand in for joins the best of the screening.
    """
    strained = {name for name, sigma in part.base.strains.items() if abs(sigma) > SUSPECT_SIGMA}
    everything = hypotheses(part.twin, sorted(part.suspects, key=part.joints.index), whole_hand=True)
    owners = [h for h in everything if h.speaks_for(part.twin)]
    quiet = part.base.chi_square <= QUIET_CHI_SQUARE
    near = {
        part.group_of(variable.joints[0])
        for variable in part.variables
        if variable.name in strained and variable.joints
    }
    asked = [h for h in everything if part.group_of(h.target) in near] if quiet and near else everything
    screened = [starts for starts in concurrently(screening.screen, asked) if starts]
    looked_at = _worth_a_look(screening, screened, {h.name for h in owners})
    entered = sorted((r for r in concurrently(screening.enter, looked_at) if r is not None), key=lambda r: r.cost)
    # costs are compared from one point of the nuisances: what one has not moved yet is not a candidate's fault
    by_anchor: dict[object, dict[str, Rough]] = {}
    for rough in entered:
        by_anchor.setdefault(rough.start.anchor, {}).setdefault(rough.hypothesis.name, rough)
    chosen: list[Rough] = []
    for best in by_anchor.values():
        first = list(best.values())[:_REFITTED]
        # of two laws of which one is the other at a bound, the simpler is always asked, too
        contained = {f"{key}:{r.hypothesis.target}" for r in first for key in r.hypothesis.effect.contains}
        chosen += first + [r for name, r in best.items() if name in contained and r not in first]
    names = {rough.hypothesis.name for rough in chosen}
    for starts in screened:
        hypothesis = starts[0].hypothesis
        if hypothesis.name not in names:
            gain = 0.5 * (screening.cost - starts[0].expected)
            reason = "takes too little of the error away to be worth a fit"
            outcome.tried.append(Trial(hypothesis.effect.key, hypothesis.target, gain, None, None, reason))
    return chosen
