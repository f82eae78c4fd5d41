"""Which effect a part is given next: candidates screened, raced, fitted in full, validated; ties looked at again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.conclude import Accepted, Outcome
from twin_daemon.diagnosis.fit import FirstFit, Fit, Start, is_idle, stands_out
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.probability import weight
from twin_daemon.diagnosis.screening import AskedBefore, Screening
from twin_daemon.diagnosis.thresholds import (
    ALIKE,
    COMPARABLE,
    DECISIVE_NATS,
    DEVIATING_SIGMA,
    FINALISTS,
    FULL_FIT_ROLLOUTS,
    LEAST_RACING,
    MOST_OF_IT,
    OTHERS_STARTS,
    OWNERS_STARTS,
    RACE_ROLLOUTS,
    SUSPECT_SIGMA,
)
from twin_daemon.diagnosis.validation import HeldOut, Validation
from twin_daemon.diagnosis.verdict import Trial
from twin_daemon.executor import concurrently, concurrently_here
from twin_daemon.processes import Say

_TAKES_LITTLE = "takes little of what is left beyond the floor away"


def next_effect(
    part: PartFit,
    validation: Validation,
    say: Say,
    outcome: Outcome,
    *,
    against: Fit | None = None,
    before: AskedBefore | None = None,
    late: bool = False,
) -> Accepted | None:
    """One more effect for a part: the best that passes held-out validation, and what it cannot be told from.

    Where it has to stand `against` a fit of the same motion, none is fitted in full unless a first fit takes most of
    what that one leaves away. Of joints that were looked at `before` on their own only what came near is asked.
    A part that is `late`, as others tell when commands come, lacks something however little its nuisances leave.
    """
    screening = Screening(part, before)
    chosen = _shortlist(screening, part, outcome)
    tried: dict[str, FirstFit] = {}
    for first in _raced(screening, chosen):
        other = tried.get(first.hypothesis.name)
        tried[first.hypothesis.name] = first if other is None or first.cost < other.cost else other
    first_fits = sorted(tried.values(), key=lambda first: first.cost)
    # at the floor, with nothing far off, an effect has to be worth its name
    forced = late or any(abs(s) > DEVIATING_SIGMA for s in part.base.deviations.values())
    unforced = part.within_floor and not forced
    if unforced and not any(map(screening.promises, (first.cost for first in first_fits))):
        for first in first_fits:
            gain = 0.5 * (screening.cost - first.cost)
            outcome.tried.append(_lost(first.hypothesis, gain, _TAKES_LITTLE))
        return None
    if not first_fits:
        return None
    if against is not None and first_fits[0].cost > MOST_OF_IT * screening.cost_of(against):
        return None
    within = [first for first in first_fits if first.cost < COMPARABLE * first_fits[0].cost + screening.floor_cost]
    # where nuisances reach the floor, costs differ by less than a first fit is good for
    finalists = within[: 2 * FINALISTS if part.within_floor else FINALISTS]
    finalists += [r for r in within if r not in finalists and finalists[0].hypothesis.contains(r.hypothesis)]
    limits = [first.hypothesis for first in finalists]
    finalists += [r for r in first_fits if r not in finalists and any(h.is_limit_of(r.hypothesis) for h in limits)]
    full, further = concurrently(lambda first: part.full_fit(first, FULL_FIT_ROLLOUTS), finalists), list[Fit]()
    held_out = concurrently_here(validation.judge, full)
    if against is None and not outcome.accepted and not any(judged.adequate for judged in held_out):
        # none of these is right alone: two causes may look most like a third, and each of the next may be one of them
        more = [r for r in first_fits if r not in finalists][: max(0, FINALISTS + 1 - len(finalists))]
        finalists += more
        further = concurrently(lambda first: part.full_fit(first, FULL_FIT_ROLLOUTS), more)
    for first in [r for r in first_fits if r not in finalists]:
        gain = 0.5 * (screening.cost - first.cost)
        behind = 0.5 * (first.cost - first_fits[0].cost)
        reason = f"explains less: {behind:.0f} nats behind {first_fits[0].hypothesis.name}"
        outcome.tried.append(_lost(first.hypothesis, gain, reason))
        say(f"  {first.hypothesis.name}: evidence {gain:.0f} nats, {behind:.0f} less than the best")
    further += _limits_of(part, screening, [*full, *further])
    further += _laws_at_limits(part, screening, [*full, *further])
    held_out += concurrently_here(validation.judge, further)
    both = zip([*full, *further], held_out, strict=True)
    fits = _best_of_each([(part.evidence_nats(fit), fit, judged) for fit, judged in both])
    for evidence, fit, _ in fits:
        say(f"  {_named(fit)}: evidence {evidence:.0f} nats, {fit.chi_square:.1f} times the floor")
    weighed = _weighed(part, screening, first_fits, [fit for _, fit, _ in fits])
    best: Accepted | None = None
    simpler: Accepted | None = None
    rivals: list[Accepted] = []
    others: list[Accepted] = []
    best_evidence = 0.0
    for evidence, fit, judged in fits:
        hypothesis = fit.hypothesis
        assert hypothesis is not None
        reason = None
        if evidence <= DECISIVE_NATS:
            reason = "adds less evidence than its parameters cost"
        elif not stands_out(fit):
            reason = "its value may as well be that of the model without it"
        elif (unforced or (judged.silent and not judged.passes)) and not part.takes_enough(fit):
            reason = _TAKES_LITTLE
        elif not judged.passes and not judged.silent:
            reason = f"does not help on held-out motion (gain {judged.gain:.0%}, interval reaches below 0)"
        elif best is None:
            best, best_evidence = Accepted(part, fit, judged), evidence
            continue
        elif simpler is None and judged.adequate and best.hypothesis.contains(hypothesis):
            simpler = Accepted(part, fit, judged)
            continue
        elif best.hypothesis.is_limit_of(hypothesis) or (
            best_evidence - evidence < decisive(best.fit) and (judged.adequate or not best.judged.adequate)
        ):
            rivals.append(Accepted(part, fit, judged))
            reason = "the data do not tell it from the best candidate"
        else:
            reason = f"explains less: {best_evidence - evidence:.0f} nats behind"
        if evidence > DECISIVE_NATS and stands_out(fit):
            others.append(Accepted(part, fit, judged))
        mse = float(np.mean([(r**2).mean() for r in fit.problem.joint_residuals(fit.point[None])]))
        held = judged.mse_after
        outcome.tried.append(_lost(hypothesis, evidence, reason, mse, held))
    if not outcome.accepted:
        outcome.others = [replace(one, weighed=weighed, decisive_nats=decisive(one.fit)) for one in others]
    if best is None:
        return None
    likelier = max((best, *rivals), key=lambda one: weighed[one.hypothesis.name])
    if likelier is not best and (likelier.judged.adequate or not best.judged.adequate):
        # by as much as the data choose between the two the errors of a model do, but not the priors
        best, rivals = likelier, [best, *(rival for rival in rivals if rival is not likelier)]
    right = next((rival for rival in rivals if rival.judged.adequate), None)
    if simpler is None and right is not None and not best.judged.adequate:
        # evidence does not choose between them, validation data do
        wrong = [best, *(rival for rival in rivals if not rival.judged.adequate)]
        outcome.tried.append(_lost(best.hypothesis, best_evidence, "leaves more on held-out motion than a right law"))
        best, rivals = right, [rival for rival in rivals if rival is not right and rival not in wrong]
        refuted = {one.hypothesis.name for one in wrong}
        weighed = {name: nats for name, nats in weighed.items() if name not in refuted}
    if simpler is not None:
        # both are right on held-out motion, and one is the other at a bound: the simpler is the answer
        weighed[simpler.hypothesis.name] = weighed[best.hypothesis.name]
        best, rivals = simpler, [*rivals, best]
    law = next((rival for rival in rivals if best.hypothesis.is_limit_of(rival.hypothesis)), None)
    if law is not None and (law.judged.adequate or not best.judged.adequate):
        # what the limit has over the law that it is a limit of is no evidence against that law
        weighed = weighed | {law.hypothesis.name: weighed[best.hypothesis.name]}
        best, rivals = law, [best, *(rival for rival in rivals if rival is not law)]
    return replace(best, rivals=tuple(rivals), weighed=weighed, decisive_nats=decisive(best.fit))


def _weighed(
    part: PartFit, screening: Screening, first_fits: Sequence[FirstFit], fits: Sequence[Fit]
) -> dict[str, float]:
    """What is known of each candidate by name, as `posterior` counts it: by its full fit, else by its first."""
    bar = decisive(min(fits, key=lambda fit: fit.cost)) if fits else DECISIVE_NATS
    prior, found = part.base.prior_cost, {}
    for first in first_fits:
        price = part.price(first.problem)
        evidence = 0.5 * (screening.cost - first.cost) - price
        # what is not worth its parameters is not there, whatever the priors say of the little that it has moved
        if part.within_floor and evidence > 0.0:
            evidence = weight(screening.cost, first.cost, prior, first.prior_cost, price, bar)
        found[first.hypothesis.name] = evidence
    return found | {_named(fit): weight_of(part, fit, bar) for fit in fits}


def weight_of(part: PartFit, fit: Fit, bar: float) -> float:
    """What is known of a fit over the nuisances alone, as `posterior` counts it where `bar` nats are decisive.

    Where uncertain values alone bring a part to its floor, their priors tell what the data do not.
    """
    if not part.within_floor:
        return part.evidence_nats(fit)
    return weight(part.base.cost, fit.cost, part.base.prior_cost, fit.prior_cost, part.price_of(fit), bar)


def _limits_of(part: PartFit, screening: Screening, laws: Sequence[Fit]) -> list[Fit]:
    """The laws that fitted ones become at a bound of theirs, fitted from where these have come to.

    No position data may tell the two apart, so that neither may be the only answer for want of a start. Those that were
    fitted from starts of their own stay as they are.
    """
    fitted = {_named(law) for law in laws}
    asked = [hypothesis for hypothesis in screening.candidates if hypothesis.name not in fitted]
    pairs = [(h, law) for law in laws for h in asked if law.hypothesis and h.is_limit_of(law.hypothesis)]

    def fitted_from(pair: tuple[Hypothesis, Fit]) -> Fit:
        hypothesis, law = pair
        return fitted_at(part, hypothesis, hypothesis.effect.as_limit_of(law.values), law.nuisances)

    return concurrently_here(fitted_from, pairs)


def _best_of_each(fits: Sequence[tuple[float, Fit, HeldOut]]) -> list[tuple[float, Fit, HeldOut]]:
    """Of (evidence in nats, fit, how it was judged) one for each candidate, those with the most evidence first.

    Of fits of one law that the data do not tell apart the one that is right on held-out motion counts.
    """
    found = []
    for name in {_named(fit): None for _, fit, _ in fits}:
        own = [item for item in fits if _named(item[1]) == name]
        most, best, _ = max(own, key=lambda item: item[0])
        near = [item for item in own if most - item[0] < decisive(best)]
        found.append(max(near, key=lambda item: (item[2].adequate, item[0])))
    return sorted(found, key=lambda item: -item[0])


def _laws_at_limits(part: PartFit, screening: Screening, limits: Sequence[Fit]) -> list[Fit]:
    """The laws that become fitted ones at a bound of theirs, fitted from there where they are not clearly better.

    At that bound a law does what its limit does: one that is worse has ended in a local optimum.
    """
    costs = {_named(fit): fit.cost for fit in limits}
    pairs = [
        (law, limit)
        for limit in limits
        for law in screening.candidates
        if limit.hypothesis
        and limit.hypothesis.is_limit_of(law)
        and costs.get(law.name, np.inf) > limit.cost - 2.0 * DECISIVE_NATS
    ]

    def fitted_from(pair: tuple[Hypothesis, Fit]) -> Fit:
        law, limit = pair
        assert limit.hypothesis is not None
        return fitted_at(part, law, limit.hypothesis.effect.as_law_at_limit(limit.values), limit.nuisances)

    return concurrently_here(fitted_from, pairs)


def fitted_at(
    part: PartFit, hypothesis: Hypothesis, values: Mapping[str, float], nuisances: Mapping[str, float]
) -> Fit:
    """The full fit of a candidate from known values and nuisances; of those that are not given, from nominal ones."""
    begun = hypothesis.starting((values, *hypothesis.starts))
    problem = part.problem_with((begun, begun.starts[0]))
    return part.ended(begun, problem, problem.start_from(nuisances), FULL_FIT_ROLLOUTS)


def _lost(
    hypothesis: Hypothesis, evidence: float, reason: str, mse: float | None = None, held: float | None = None
) -> Trial:
    return Trial(
        effect=hypothesis.effect.key,
        target=hypothesis.target,
        evidence_nats=evidence,
        fit_mse_rad2=mse,
        holdout_mse_rad2=held,
        lost_because=reason,
    )


def _named(fit: Fit) -> str:
    return fit.hypothesis.name if fit.hypothesis else ""


def decisive(best: Fit) -> float:
    """Nats by which another candidate has to be behind: more where the best is itself not down at the noise."""
    return max(DECISIVE_NATS, ALIKE * 0.5 * best.cost)


def _promising(entered: Sequence[FirstFit]) -> list[FirstFit]:
    """The best start of each candidate from each point of the nuisances, of candidates in the order of their costs.

    What one has not moved yet is not its fault: a start that promises far more than the best has is another chance.
    """
    best: dict[tuple[str, frozenset[str] | None], FirstFit] = {}
    for first in entered:
        best.setdefault((first.hypothesis.name, first.start.anchor), first)
    return [
        first
        for first in entered
        if first is (own := best[first.hypothesis.name, first.start.anchor])
        or COMPARABLE * first.start.expected < own.cost
    ]


def _worth_a_look(screening: Screening, screened: Sequence[Sequence[Start]], owners: set[str]) -> list[Start]:
    """The starts that are rolled out as they are: from each point of the nuisances, the best of every candidate.

    Where the nuisances fit best without it, the right effect may have little to add. So the points are not compared.
    """
    looked_at: list[Start] = []
    for anchor in dict.fromkeys(start.anchor for starts in screened for start in starts):
        for starts in screened:
            here = [start for start in starts if start.anchor == anchor]
            looked_at += here[: OWNERS_STARTS if starts[0].hypothesis.name in owners else OTHERS_STARTS]
    return looked_at


def _raced(screening: Screening, entered: Sequence[FirstFit]) -> list[FirstFit]:
    """Candidates that are fitted a little each, the better half goes on, until few are left: successive halving.

    Nothing is dropped for where it starts (Jamieson and Talwalkar 2016): a law that is far from its values looks
    bad until it has moved.
    """
    racing = sorted(entered, key=lambda first: first.cost)
    out: list[FirstFit] = []
    for evaluations in RACE_ROLLOUTS:
        last = evaluations == RACE_ROLLOUTS[-1] or len(racing) <= LEAST_RACING
        count = RACE_ROLLOUTS[-1] if last else evaluations
        moved = concurrently(lambda first, n=count, f=last: screening.first_fit(first, n, settled=f), racing)
        moved.sort(key=lambda first: first.cost)
        if last:
            return [*moved, *out]
        # from here on each goes on from the better of the points of the nuisances that it was begun at
        own = sorted({first.hypothesis.name: first for first in reversed(moved)}.values(), key=lambda first: first.cost)
        kept = max(LEAST_RACING, len(own) // 2)
        racing, lost = own[:kept], own[kept:]
        out += lost
    return [*racing, *out]


def _shortlist(screening: Screening, part: PartFit, outcome: Outcome) -> list[FirstFit]:
    """Where to start the fits that are worth one: the best start of each candidate by the cost that it has.

    What a nuisance stands in for is invisible beside it. Where nuisances alone reach the floor by deviating, only
    effects at their joints are asked; elsewhere what they stand in for joins the best of the screening.
    """
    deviating = {name for name, sigma in part.base.deviations.items() if abs(sigma) > SUSPECT_SIGMA}
    everything = screening.candidates
    owners = [h for h in everything if h.speaks_for(part.twin)]
    within_floor = part.within_floor
    near = {
        part.group_of(variable.joints[0])
        for variable in part.variables
        if variable.name in deviating and variable.joints
    }
    near |= {part.group_of(joint) for joint in part.joints if f"{joint}.offset" in deviating}
    asked = [h for h in everything if part.group_of(h.target) in near] if within_floor and near else everything
    screened = [starts for starts in concurrently(screening.screen, asked) if starts]
    looked_at = _worth_a_look(screening, screened, {h.name for h in owners})
    entered = sorted((r for r in concurrently(screening.enter, looked_at) if r is not None), key=lambda r: r.cost)
    chosen = _promising(entered)
    names = {first.hypothesis.name for first in chosen}
    for starts in screened:
        hypothesis = starts[0].hypothesis
        if hypothesis.name not in names:
            gain = 0.5 * (screening.cost - starts[0].expected)
            reason = "cannot stand beside what the model has"
            outcome.tried.append(_lost(hypothesis, gain, reason))
    return chosen


def swap_rivals(
    first: PartFit,
    accepted: Sequence[Accepted],
    evaluations: int,
) -> list[Accepted]:
    """The findings, each in turn with the best of itself and its rivals, all fitted together on the first part.

    While something else is missing, a wrong law may look as good as the right one, because what is missing leaves more
    than what tells the two apart. Beside all the others they are compared again.

    A rival stays one where it is no further behind than is decisive for the best; of these the most probable one
    stands first, but for a law of which only its other parameters do anything, such as a spring without
    stiffness. A richer law of the same kind is not asked, as it can only seem better.
    """
    found = list(accepted)
    for index, item in enumerate(found):
        asked = [rival for rival in item.rivals if not rival.hypothesis.contains(item.hypothesis)]
        if not asked:
            continue
        choices = [item, *asked]
        beside = [[*found[:index], choice, *found[index + 1 :]] for choice in choices]
        # each begins where the nuisances were beside it: now they fit the effect that is to give way
        starts = list(zip(beside, choices, strict=True))
        fits = concurrently(lambda s: first.full_fit_together([a.fit for a in s[0]], evaluations, s[1].fit), starts)
        evidence = _not_below_limits(choices, [first.evidence_nats(joint[index]) for joint in fits])
        most = max(range(len(choices)), key=evidence.__getitem__)
        bar = evidence[most] - decisive(fits[most][index])
        tied = [i for i, nats in enumerate(evidence) if i == most or nats > bar]
        limits = {i for i, j in permutations(tied, 2) if choices[i].hypothesis.is_limit_of(choices[j].hypothesis)}
        beyond = decisive(fits[most][index])
        weights = _not_below_limits(choices, [weight_of(first, joint[index], beyond) for joint in fits])
        best = min(tied, key=lambda i: (is_idle(fits[i][index]), -weights[i], i in limits))
        close = tuple(choices[i] for i in tied if i != best)
        moved = weights[0] - item.weighed[item.hypothesis.name]  # all others as far behind it as they were
        weighed = {name: nats + moved for name, nats in item.weighed.items()}
        weighed |= {c.hypothesis.name: nats for c, nats in zip(choices, weights, strict=True)}
        richer = tuple(r for r in item.rivals if r not in asked) if best == 0 else ()
        found = [replace(a, fit=fit) for a, fit in zip(beside[best], fits[best], strict=True)]
        found[index] = replace(
            found[index],
            rivals=(*(replace(c, rivals=()) for c in close), *richer),
            weighed=weighed,
            decisive_nats=beyond,
        )
    return found


def _not_below_limits(choices: Sequence[Accepted], nats: Sequence[float]) -> list[float]:
    """The nats of each choice; of a law no less than those of what it becomes at a bound of its own."""
    found = list(nats)
    for limit, law in permutations(range(len(choices)), 2):
        if choices[limit].hypothesis.is_limit_of(choices[law].hypothesis):
            found[law] = max(found[law], found[limit])
    return found
