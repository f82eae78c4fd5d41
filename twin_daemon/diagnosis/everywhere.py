"""Causes that all servos or joints have: looked for before, behind and after what each group says."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.diagnosis.all_servos import of_all_servos
from twin_daemon.diagnosis.as_fitted import looked_at_again
from twin_daemon.diagnosis.common_delay import within_a_cycle
from twin_daemon.diagnosis.conclude import Outcome
from twin_daemon.diagnosis.far_off import plainly_above
from twin_daemon.diagnosis.floor_check import within_floor
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.shared import Shared, SharedSearch
from twin_daemon.diagnosis.shared_cause import shared_causes
from twin_daemon.diagnosis.thresholds import CLOSER_LOOK, COMMON_DELAY_SIGMA, DEVIATING_SIGMA, OF_ALL_LEFT
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.estimation.nuisances import NOMINAL_KINDS
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.executor import concurrently
from twin_daemon.places import ROBOT
from twin_daemon.processes import Say
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

_DELAY = "delay"  # what is uncertain about the time of all commands of a recording


def of_all(
    twin: TwinModel,
    reduction: Reduction,
    begun: Sequence[tuple[Reduced, PartFit]],
    seed: int,
    say: Say,
) -> Shared | None:
    """One cause that all servos or joints have, before anything else is fitted; None where it is not as clear as that.

    A late bus is felt by every group, and what is uncertain about each would be fitted in vain. What a load may be
    mistaken for is held against every load that all of them feel: an arm sags under one as with a weak supply.
    """
    if 2 * sum(not part.within_floor for _, part in begun) <= len(begun):
        return None
    search = SharedSearch(twin, reduction, begun)
    chosen = search.above(CLOSER_LOOK)
    if len(chosen) < 2 or 2 * len(chosen) <= len(begun):
        return None
    above = [begun[i] for i in chosen]
    joints = [reduced.joints for reduced, _ in above]
    causes = shared_causes(twin, joints, everywhere=True)
    of_robot, search = [cause for cause in causes if cause.target == ROBOT], search.only(chosen)
    found = search.best(of_robot, seed, most_left=OF_ALL_LEFT)
    if found is None:
        return None
    loads = [cause for cause in causes if cause.is_load and found.finding.effect in cause.effect.confusable]
    if loads and search.nearly_as_good(loads):
        found = search.best([*of_robot, *loads], seed, most_left=OF_ALL_LEFT)
    return _said(found, len(above), say) if found and found.finding.target == ROBOT else None


def behind_all(
    twin: TwinModel,
    reduction: Reduction,
    above: Sequence[tuple[Reduced, PartFit]],
    groups: int,
    seed: int,
    say: Say,
) -> tuple[Shared | None, EffectTerm | None]:
    """(one cause behind all groups above the floor, a load that may be one of several things wrong with them).

    One cause is cheaper than one each, so it is tried first. Beside one of several the search of all begins. A load is
    looked for where all feel it that are plainly above the floor: others may have been told a wrong motion of these.
    """
    everywhere = 2 * len(above) > groups
    plainly = [one for one in above if plainly_above(one[1])]
    if not everywhere and len(plainly) > 1:
        above = plainly
    causes = shared_causes(twin, [reduced.joints for reduced, _ in above], everywhere=everywhere)
    search = SharedSearch(twin, reduction, above)
    found = search.best(causes, seed)
    if found is not None and found.one_of_several:
        return None, found.finding.term
    return _said(found, len(above), say), None if found else search.nearly


def _said(found: Shared | None, above: int, say: Say) -> Shared | None:
    """What was found of so many groups above the floor, once it has been said."""
    if found is not None:
        named = " and ".join(one.name for one in found.findings)
        say(f"{named} explains {len(found.looked_at)} of {above} groups above the floor")
    return found


def in_common(
    twin: TwinModel,
    reduction: Reduction,
    looked_at: Sequence[tuple[Reduced, PartFit]],
    seed: int,
    say: Say,
) -> Shared | None:
    """A cause of all servos or joints that no group alone would speak of; None where there is none.

    One gain may be three sigma off. Eleven that are three sigma off the same way are a supply that sags: under what is
    known of nominal values their mean has a sigma of one over the root of eleven. A weak servo without gravity looks
    like one with more to move, and a late bus like damping, so that whatever is off asks for all of them. But where
    all agree on a delay that a cycle of the robot explains, what made up for it in each of them is no cause. A few that
    have something of their own say nothing of it.
    """
    groups, looked_at = len(looked_at), [one for one in looked_at if one[1].within_floor]
    if 2 * len(looked_at) <= groups:
        return None
    if not any(_off_the_same_way(looked_at, kind) for kind in (*NOMINAL_KINDS, _DELAY)):
        return None
    delays = within_a_cycle([part for _, part in looked_at])
    if delays is not None:
        reduction = reduction.delayed(delays)
        looked_at = looked_at_again(twin, reduction, [reduced for reduced, _ in looked_at])
        if not any(_off_the_same_way(looked_at, kind) for kind in NOMINAL_KINDS):
            return None
    # a load on all of them makes each of them look heavier
    causes = shared_causes(twin, [reduced.joints for reduced, _ in looked_at], everywhere=True)
    shared = SharedSearch(twin, reduction, looked_at).best(causes, seed)
    if shared is None:
        return None
    say(f"{shared.finding.name}: nominal values of all groups are off the same way")
    return shared


def _off_the_same_way(looked_at: Sequence[tuple[Reduced, PartFit]], kind: str) -> bool:
    """Whether the nominal values of a kind ("kp", "damping", ...) are off by more than each on its own may be.

    A delay is one value for all, whatever each group says of it: their mean is no better known than one of them, and
    many agree on any. What is further off than a value of any hand is one group's own, and counts as that far.
    """
    found = [sigma for _, part in looked_at for name, sigma in part.base.deviations.items() if kind in name.split(".")]
    if len(found) < 2:
        return False
    most = COMMON_DELAY_SIGMA if kind == _DELAY else DEVIATING_SIGMA / len(found) ** 0.5
    return abs(float(np.clip(found, -DEVIATING_SIGMA, DEVIATING_SIGMA).mean())) > most


def with_everywhere(group: Reduced, finding: Finding) -> Reduced:
    term = EffectTerm(effect=finding.effect, target=ROBOT, values=finding.values)
    return replace(group, twin=group.twin.changed(group.twin.terms.with_effect(term)))


def at_all(
    finding: Finding, groups: Sequence[Reduced], outcomes: list[Outcome], seed: int, say: Say
) -> tuple[Finding, list[tuple[Reduced, PartFit]]]:
    """(a cause with all groups that have it, the groups at which something is missing beside it).

    A cause that all servos or joints have is theirs, too, at which it hardly shows, or beside which they have one of
    their own. What their nominal values stood in for is taken back in `outcomes`.
    """
    if finding.target != ROBOT:
        return finding, []
    changed = [with_everywhere(group, finding) for group in groups]
    known = {outcome.joints: place for place, outcome in enumerate(outcomes)}
    theirs: list[str] = []
    above: list[tuple[Reduced, PartFit]] = []
    for reduced, part in concurrently(look, changed):
        outcome = within_floor(part, reduced, seed, say, seen=True)
        if outcome is None and part.joints in known:
            continue  # sound without it, and not with it
        theirs += part.joints
        if outcome is None:
            above.append((reduced, part))
        elif part.joints in known:
            outcomes[known[part.joints]] = outcome
        else:
            outcomes.append(outcome)
    return finding.model_copy(update={"joints": (*finding.joints, *theirs)}), above


def said_once(
    groups: Sequence[Reduced], outcomes: Sequence[Outcome], seed: int, say: Say
) -> tuple[Finding, list[Outcome]] | None:
    """(a cause that was found at one servo after another and that all others have as well, the outcomes without it)."""
    found = of_all_servos(outcomes)
    if found is None:
        return None
    finding, left = found[0], list(found[1])
    rest = [group for group in groups if not set(group.joints) <= set(finding.joints)]
    everywhere, above = at_all(finding, rest, left, seed, say)
    # what is above the floor with it would have to be searched again: one at each servo says no less
    if above or any(not set(group.joints) <= set(everywhere.joints) for group in rest):
        return None
    say(f"{finding.name}: found at one servo after another, with one value for all")
    return everywhere, left
