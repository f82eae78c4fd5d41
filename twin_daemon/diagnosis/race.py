"""The race of a part's candidates: which are begun where, and first fits on some of the motion until few are left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.conclude import Outcome
from twin_daemon.diagnosis.fit import FirstFit, Fit, Start
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.thresholds import (
    COMPARABLE,
    LEAST_RACING,
    ON_THE_WAY,
    OTHERS_STARTS,
    OWNERS_STARTS,
    RACE_ROLLOUTS,
    SUSPECT_SIGMA,
)
from twin_daemon.diagnosis.verdict import Trial
from twin_daemon.executor import concurrently

TAKES_LITTLE = "takes little of what is left beyond the floor away"
"""Why a candidate is none at a part that is at its floor."""


def shortlist(screening: Screening, part: PartFit, outcome: Outcome, *, unforced: bool) -> list[FirstFit]:
    """Where to start the fits that are worth one: the best start of each candidate by the cost that it has.

    What a nuisance stands in for is invisible beside it. Where nuisances alone reach the floor by deviating, only
    effects at their joints are asked; elsewhere what they stand in for joins the best of the screening. Of a part that
    is `unforced` to have any, as it is at its floor with nothing far off, those are begun that may be worth their name,
    if any may.
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
    promising = [starts for starts in screened if unforced and screening.promises(starts[0].expected)]
    if promising:
        for first in (starts[0] for starts in screened if not screening.promises(starts[0].expected)):
            outcome.tried.append(lost(first.hypothesis, 0.5 * (screening.cost - first.expected), TAKES_LITTLE))
        screened = promising
    looked_at = _worth_a_look(screening, screened, {h.name for h in owners})
    entered = sorted((r for r in concurrently(screening.enter, looked_at) if r is not None), key=lambda r: r.cost)
    chosen = _promising(entered)
    names = {first.hypothesis.name for first in chosen}
    for starts in screened:
        hypothesis = starts[0].hypothesis
        if hypothesis.name not in names:
            gain = 0.5 * (screening.cost - starts[0].expected)
            reason = "cannot stand beside what the model has"
            outcome.tried.append(lost(hypothesis, gain, reason))
    return chosen


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


def raced(screening: Screening, entered: Sequence[FirstFit], most: float) -> list[FirstFit]:
    """Candidates that are fitted a little each, the better half goes on, until few are left: successive halving.

    Nothing is dropped for where it starts (Jamieson and Talwalkar 2016): a law that is far from its values looks
    bad until it has moved. Where one is worth its name only if it brings the cost down to `most`, and none has come a
    part of the way there once all have been moved, none is left.
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
        to_take = screening.cost - most
        if to_take > 0.0 and screening.cost - moved[0].cost < ON_THE_WAY * to_take:
            return []
        # from here on each goes on from the better of the points of the nuisances that it was begun at
        own = sorted({first.hypothesis.name: first for first in reversed(moved)}.values(), key=lambda first: first.cost)
        kept = max(LEAST_RACING, len(own) // 2)
        racing = own[:kept]
        out += [replace(first, slopes=None) for first in own[kept:]]  # these are not gone on with
    return [*racing, *out]


def lost(
    hypothesis: Hypothesis, evidence: float, reason: str, fit: Fit | None = None, held: float | None = None
) -> Trial:
    """What is told of a candidate that was asked and is not the answer: its evidence in nats, and what a fit leaves.

    `held` is in rad^2.
    """
    mse, floors = None, None
    if fit is not None:
        mse = float(np.mean([(r**2).mean() for r in fit.problem.joint_residuals(fit.point[None])]))
        floors = fit.cost / fit.problem.effective_samples
    return Trial(
        effect=hypothesis.effect.key,
        target=hypothesis.target,
        evidence_nats=evidence,
        fit_mse_rad2=mse,
        holdout_mse_rad2=held,
        left_times_floor=floors,
        lost_because=reason,
    )
