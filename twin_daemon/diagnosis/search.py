"""The diagnosis: part by part, from the residual to a named cause, or to the plain word that there is none."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import replace

from twin_daemon.diagnosis.as_fitted import as_fitted, closer, links_uncertain
from twin_daemon.diagnosis.common_delay import common_delay
from twin_daemon.diagnosis.conclude import Outcome, conclude, nothing_moves
from twin_daemon.diagnosis.everywhere import at_all, behind_all, in_common, of_all, said_once, with_everywhere
from twin_daemon.diagnosis.far_off import deviating
from twin_daemon.diagnosis.floor_check import above_floor
from twin_daemon.diagnosis.group import at_nominal, look
from twin_daemon.diagnosis.left_out import LeftOut
from twin_daemon.diagnosis.near import when_near
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.part_search import begun_outcome
from twin_daemon.diagnosis.shared import Shared
from twin_daemon.diagnosis.thresholds import MOST_EFFECTS
from twin_daemon.diagnosis.unit_search import UnitSearch, units
from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.executor import concurrently
from twin_daemon.places import ROBOT
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime, TimeLimit
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm
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
    findings: list[Finding] = []
    left_out = LeftOut()
    looked_at: list[tuple[Reduced, PartFit]] = []
    above: list[tuple[Reduced, PartFit]] = []
    causes: list[Mapping[str, float]] = []
    shared: Shared | None = None
    first: EffectTerm | None = None  # of several effects of groups that are searched together
    interrupted = False
    try:
        with contextlib.ExitStack() as stack:
            chosen = [(g, own) for g in drive_groups(twin) if (own := [n for n in moving if n in g.joints])]
            cut = reduction.each(twin, chosen)
            groups = [reduced for reduced in cut if reduced is not None]
            unseen = [one for one, reduced in zip(chosen, cut, strict=True) if reduced is None]
            left_out.touching = {group.name: tuple(own) for group, own in unseen}
            left_out.cut(reduction, groups)
            looked_at = begun = concurrently(at_nominal, groups)
            with limit.enforced():
                shared = of_all(twin, reduction, begun, seed, say)
            looked_at = [] if shared else concurrently(_looked_at, begun)
            stack.enter_context(limit.enforced())  # what a first look says is said however long it takes
            late = common_delay([part for _, part in looked_at if part.within_floor])
            if late is not None:
                reduction = reduction.delayed(late.by_recording)
            behind = [one for one in looked_at if late is not None and one[1] in late.late]
            others = [one for one in looked_at if one not in behind]
            feel_each_other = links_uncertain(twin) or reduction.carries
            anew = feel_each_other and any(not part.within_floor for _, part in others)
            late_at = frozenset(joint for _, part in behind for joint in part.joints)
            above = behind + above_floor(others, outcomes, seed, say, anew=anew)
            known = {part.joints: (reduced, part) for reduced, part in looked_at}
            if above and (behind or feel_each_other):
                reduction, again = closer(twin, reduction, looked_at, above)
                known |= {part.joints: (reduced, part) for reduced, part in again}
                above = above_floor(again, outcomes, seed, say, late=late_at)
            else:
                above = [look(reduced) if part.nominal else (reduced, part) for reduced, part in above]
            if sum(not one.within_floor or bool(deviating(one)) for _, one in above) > 1:
                shared = behind_all(twin, reduction, above, len(looked_at), seed, say)
                if shared is not None and shared.one_of_several:
                    first, shared = shared.finding.term, None
            if shared is None and first is None:
                shared = in_common(twin, reduction, list(known.values()), seed, say)
            if not above and shared is None:
                reduction, above, seen = when_near(twin, reduction, looked_at, unseen, outcomes, seed, say)
                groups += seen
                for group in seen:
                    left_out.touching.pop(group.name, None)
                left_out.cut(reduction, groups)
                left_out.near = [reduced.name for reduced, _ in above]
            while shared is not None:
                theirs = {part.joints for _, part in shared.looked_at}
                outcomes = [outcome for outcome in outcomes if outcome.joints not in theirs]
                for reduced, part in shared.settled:
                    outcomes.append(replace(begun_outcome(reduced, part), within_floor=True))
                groups = [group for group in groups if group.joints not in theirs]
                findings += shared.findings  # it is found, whatever time is left for who else has it
                causes += shared.posteriors
                finding, above = at_all(shared.finding, groups, outcomes, seed, say)
                findings[-len(shared.findings)] = finding
                above = shared.forced + above
                if finding.target != ROBOT:
                    break
                # beside what all have some may have something of their own, which several feel
                twin = twin.changed(shared.terms)
                looked_at = [*shared.settled, *above]
                reduction, again = closer(twin, reduction, looked_at, above)
                above = above_floor(again, outcomes, seed, say)
                groups = [with_everywhere(group, finding) for group in groups]
                shared = behind_all(twin, reduction, above, len(begun), seed, say) if len(above) > 1 else None
            fitted = as_fitted(twin, looked_at)
            search = UnitSearch(twin, reduction, fitted, seed, say, most_effects, outcomes, left_out.touching, late_at)
            if not (findings or first) and (beside := search.behind_the_others(above, len(begun))):
                findings += beside.findings
                causes += beside.posteriors
                # alone: what the worst one has of its own is searched again beside it
                for finding in beside.findings:
                    twin = twin.changed(twin.terms.with_effect(finding.term))
                reduction, again = closer(twin, reduction, looked_at, above)
                above = above_floor(again, outcomes, seed, say)
                fitted = as_fitted(twin, [*looked_at, *above])
                search = replace(search, twin=twin, reduction=reduction, fitted=fitted)
            for unit in units(twin, above):
                if unit := search.still_above(unit):
                    search.search(unit, first)
            if not findings and (once := said_once(groups, outcomes, seed, say)):
                finding, outcomes = once
                findings.append(finding)
                causes.append({finding.name: finding.probability or 0.0})
    except (KeyboardInterrupt, OutOfTime):
        interrupted = True
    judged = {joint for outcome in outcomes for joint in outcome.joints}
    left = [(reduced, part, False) for reduced, part in above]
    if interrupted:
        # time may have been over before it was known which of these are above the floor on other motion as well
        known = {part.joints for _, part in above}
        left += [(reduced, part, part.within_floor) for reduced, part in looked_at if part.joints not in known]
    for reduced, part, sound in left:
        if not judged & set(reduced.joints):
            outcomes.append(replace(begun_outcome(reduced, part), unfinished=True, within_floor=sound))
    interrupted = interrupted or any(outcome.unfinished for outcome in outcomes)
    return conclude(twin, train, outcomes, left_out, interrupted, findings, causes)


def _looked_at(begun: tuple[Reduced, PartFit]) -> tuple[Reduced, PartFit]:
    """A group with what is uncertain about it fitted, unless it is at the floor of its sensors as it is."""
    return begun if begun[1].plainly_sound else look(*begun)
