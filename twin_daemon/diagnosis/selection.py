"""Which effect a part is given next: candidates screened, raced, fitted in full, validated; ties looked at again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin_daemon.diagnosis.conclude import Accepted, Outcome
from twin_daemon.diagnosis.fit import FirstFit, Fit, stands_out
from twin_daemon.diagnosis.limits import laws_at_limits, limits_of
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.race import TAKES_LITTLE, lost, raced, shortlist
from twin_daemon.diagnosis.screening import AskedBefore, Screening
from twin_daemon.diagnosis.thresholds import (
    COMPARABLE,
    DECISIVE_NATS,
    DEVIATING_SIGMA,
    FINALISTS,
    FULL_FIT_ROLLOUTS,
    MOST_OF_IT,
)
from twin_daemon.diagnosis.validation import HeldOut, Validation
from twin_daemon.diagnosis.weighing import decisive, weighed
from twin_daemon.executor import concurrently, concurrently_here
from twin_daemon.processes import Say


@dataclass
class _Candidates:
    """Fits that passed: the best, a simpler law that the best contains, and what the data do not tell from the best.

    `helpful` are all that help at all, passed or not.
    """

    best: Accepted | None = None
    best_nats: float = 0.0
    simpler: Accepted | None = None
    rivals: list[Accepted] = field(default_factory=list)
    helpful: list[Accepted] = field(default_factory=list)


def next_effect(
    part: PartFit,
    validation: Validation,
    say: Say,
    outcome: Outcome,
    *,
    against: Fit | None = None,
    takes: float = 0.0,
    before: AskedBefore | None = None,
    late: bool = False,
) -> Accepted | None:
    """One more effect for a part: the best that passes held-out validation, and what it cannot be told from.

    It is worth a name where it `takes` at least such a share of the cost away.
    Where it has to stand `against` a fit of the same motion, none is fitted in full unless a first fit takes most of
    what that one leaves away. Of joints that were looked at `before` on their own only what came near is asked.
    A part that is `late`, as others tell when commands come, lacks something however little its nuisances leave.
    """
    screening = Screening(part, before)
    # at the floor, with nothing far off, an effect has to be worth its name
    forced = late or any(abs(s) > DEVIATING_SIGMA for s in part.base.deviations.values())
    unforced = part.within_floor and not forced
    reach = np.inf if against is None else MOST_OF_IT * screening.cost_of(against)
    most = min(reach, (1.0 - takes) * screening.cost)
    tried: dict[str, FirstFit] = {}
    for first in raced(screening, shortlist(screening, part, outcome, unforced=unforced), most):
        other = tried.get(first.hypothesis.name)
        tried[first.hypothesis.name] = first if other is None or first.cost < other.cost else other
    first_fits = sorted(tried.values(), key=lambda first: first.cost)
    if unforced and not any(map(screening.promises, (first.cost for first in first_fits))):
        for first in first_fits:
            outcome.tried.append(lost(first.hypothesis, 0.5 * (screening.cost - first.cost), TAKES_LITTLE))
        return None
    if not first_fits or first_fits[0].cost > reach:
        return None
    only = against is None and not outcome.accepted
    fits = _in_full(part, validation, screening, first_fits, say, outcome, only=only)
    nats = weighed(part, screening, first_fits, [fit for _, fit, _ in fits])
    found = _told_apart(part, fits, outcome, unforced=unforced)
    if not outcome.accepted:
        outcome.others = [replace(one, weighed=nats, decisive_nats=decisive(one.fit)) for one in found.helpful]
    return _answer(found, nats, outcome)


def _in_full(
    part: PartFit,
    validation: Validation,
    screening: Screening,
    first_fits: Sequence[FirstFit],
    say: Say,
    outcome: Outcome,
    *,
    only: bool,
) -> list[tuple[float, Fit, HeldOut]]:
    """(evidence in nats, fit, how it was judged) of the candidates that come near the best, the best first.

    `only` says that the effect would be the part's only one so far.
    """
    best = first_fits[0]
    within = [first for first in first_fits if first.cost < COMPARABLE * best.cost + screening.floor_cost]
    # where nuisances reach the floor, costs differ by less than a first fit is good for
    finalists = within[: 2 * FINALISTS if part.within_floor else FINALISTS]
    finalists += [r for r in within if r not in finalists and finalists[0].hypothesis.contains(r.hypothesis)]
    limits = [first.hypothesis for first in finalists]
    finalists += [r for r in first_fits if r not in finalists and any(h.is_limit_of(r.hypothesis) for h in limits)]
    full, further = concurrently(lambda first: part.full_fit(first, FULL_FIT_ROLLOUTS), finalists), list[Fit]()
    held_out = concurrently_here(validation.judge, full)
    if only and not any(judged.adequate for judged in held_out):
        # none of these is right alone: two causes may look most like a third, and each of the next may be one of them
        more = [r for r in first_fits if r not in finalists][: max(0, FINALISTS + 1 - len(finalists))]
        finalists += more
        further = concurrently(lambda first: part.full_fit(first, FULL_FIT_ROLLOUTS), more)
    for first in [r for r in first_fits if r not in finalists]:
        gain = 0.5 * (screening.cost - first.cost)
        behind = 0.5 * (first.cost - best.cost)
        reason = f"explains less: {behind:.0f} nats behind {best.hypothesis.name}"
        outcome.tried.append(lost(first.hypothesis, gain, reason))
        say(f"  {first.hypothesis.name}: evidence {gain:.0f} nats, {behind:.0f} less than the best")
    further += limits_of(part, screening, [*full, *further])
    further += laws_at_limits(part, screening, [*full, *further])
    held_out += concurrently_here(validation.judge, further)
    both = zip([*full, *further], held_out, strict=True)
    fits = _best_of_each([(part.evidence_nats(fit), fit, judged) for fit, judged in both])
    for evidence, fit, _ in fits:
        say(f"  {fit.name}: evidence {evidence:.0f} nats, {fit.chi_square:.1f} times the floor")
    return fits


def _best_of_each(fits: Sequence[tuple[float, Fit, HeldOut]]) -> list[tuple[float, Fit, HeldOut]]:
    """Of (evidence in nats, fit, how it was judged) one for each candidate, those with the most evidence first.

    Of fits of one law that the data do not tell apart the one that is right on held-out motion counts.
    """
    found = []
    for name in {fit.name: None for _, fit, _ in fits}:
        own = [item for item in fits if item[1].name == name]
        most, best, _ = max(own, key=lambda item: item[0])
        near = [item for item in own if most - item[0] < decisive(best)]
        found.append(max(near, key=lambda item: (item[2].adequate, item[0])))
    return sorted(found, key=lambda item: -item[0])


def _told_apart(
    part: PartFit, fits: Sequence[tuple[float, Fit, HeldOut]], outcome: Outcome, *, unforced: bool
) -> _Candidates:
    """Which of the fits passed, and why each of the others did not, which `outcome` then has as tried."""
    found = _Candidates()
    for evidence, fit, judged in fits:
        hypothesis = fit.hypothesis
        assert hypothesis is not None
        best, behind = found.best, found.best_nats - evidence
        if evidence <= DECISIVE_NATS:
            reason = "adds less evidence than its parameters cost"
        elif not stands_out(fit):
            reason = "its value may as well be that of the model without it"
            outcome.neutral = outcome.neutral or fit
        elif (unforced or (judged.silent and not judged.passes)) and not part.takes_enough(fit):
            reason = TAKES_LITTLE
        elif not judged.passes and not judged.silent:
            reason = f"does not help on held-out motion (gain {judged.gain:.0%}, interval reaches below 0)"
        elif best is None:
            found.best, found.best_nats = Accepted(part, fit, judged), evidence
            continue
        elif found.simpler is None and judged.adequate and best.hypothesis.contains(hypothesis):
            found.simpler = Accepted(part, fit, judged)
            continue
        elif best.hypothesis.is_limit_of(hypothesis) or (
            behind < decisive(best.fit) and (judged.adequate or not best.judged.adequate)
        ):
            found.rivals.append(Accepted(part, fit, judged))
            reason = "the data do not tell it from the best candidate"
        else:
            reason = f"explains less: {behind:.0f} nats behind"
        if evidence > DECISIVE_NATS and stands_out(fit):
            found.helpful.append(Accepted(part, fit, judged))
        outcome.tried.append(lost(hypothesis, evidence, reason, fit, judged.mse_after))
    return found


def _answer(found: _Candidates, nats: Mapping[str, float], outcome: Outcome) -> Accepted | None:
    """Which of those that passed stands first, with those that it cannot be told from as its rivals."""
    best, rivals, simpler, nats = found.best, found.rivals, found.simpler, dict(nats)
    if best is None:
        return None
    likelier = max((best, *rivals), key=lambda one: nats[one.hypothesis.name])
    if likelier is not best and (likelier.judged.adequate or not best.judged.adequate):
        # by as much as the data choose between the two the errors of a model do, but not the priors
        best, rivals = likelier, [best, *(rival for rival in rivals if rival is not likelier)]
    right = next((rival for rival in rivals if rival.judged.adequate), None)
    if simpler is None and right is not None and not best.judged.adequate:
        # evidence does not choose between them, validation data do
        wrong = [best, *(rival for rival in rivals if not rival.judged.adequate)]
        outcome.tried.append(lost(best.hypothesis, found.best_nats, "leaves more on held-out motion than a right law"))
        best, rivals = right, [rival for rival in rivals if rival is not right and rival not in wrong]
        refuted = {one.hypothesis.name for one in wrong}
        nats = {name: value for name, value in nats.items() if name not in refuted}
    if simpler is not None:
        # both are right on held-out motion, and one is the other at a bound: the simpler is the answer
        nats[simpler.hypothesis.name] = nats[best.hypothesis.name]
        best, rivals = simpler, [*rivals, best]
    law = next((rival for rival in rivals if best.hypothesis.is_limit_of(rival.hypothesis)), None)
    if law is not None and (law.judged.adequate or not best.judged.adequate):
        # what the limit has over the law that it is a limit of is no evidence against that law
        nats[law.hypothesis.name] = nats[best.hypothesis.name]
        best, rivals = law, [best, *(rival for rival in rivals if rival is not law)]
    return replace(best, rivals=tuple(rivals), weighed=nats, decisive_nats=decisive(best.fit))
