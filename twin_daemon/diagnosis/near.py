"""Motion in which parts come near without a touch: looked at where all that is clear of any is at its floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.diagnosis.conclude import Outcome
from twin_daemon.diagnosis.floor_check import above_floor
from twin_daemon.diagnosis.group import look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import CLOSER_LOOK
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.thresholds import LEAST_CLEAR_S
from twin_daemon.executor import concurrently_here
from twin_daemon.processes import Say
from twin_daemon.simulation.submodel import Part
from twin_daemon.simulation.twin import TwinModel


def when_near(
    twin: TwinModel,
    reduction: Reduction,
    looked_at: Sequence[tuple[Reduced, PartFit]],
    unseen: Sequence[tuple[Part, Sequence[str]]],
    outcomes: list[Outcome],
    seed: int,
    say: Say,
) -> tuple[Reduction, list[tuple[Reduced, PartFit]], list[Reduced]]:
    """(a reduction that leaves out only touches that readings show; the groups at which something is missing there;
    those of the `unseen` that it lets see).

    Neighbouring fingers pass each other within the millimetre that counts as a touch, half of the time. A reading that
    is off shows no touch where there is one, so that motion which is clear even then is asked first, and has to find
    nothing. Of the groups `looked_at` those are fitted anew whose fit to it does not foresee the other motion. What
    the groups that are found here said of it is taken out of `outcomes`. The `unseen` are near something all the time,
    as a reading that is off by much may make a finger seem to be.
    """
    nearer = reduction.where_near()
    more = [
        (group, part)
        for group, part in looked_at
        if nearer.clear_s(group.joints) > reduction.clear_s(group.joints) + LEAST_CLEAR_S
    ]
    fresh = [group for group in nearer.each(twin, unseen) if group is not None]
    if not more and not fresh:
        return reduction, [], []
    names = [*(group.name for group, _ in more), *(group.name for group in fresh)]
    say(f"{', '.join(names)}: once more, with the motion in which something only comes near")

    def unforeseen(one: tuple[Reduced, PartFit]) -> tuple[Reduced, PartFit] | None:
        group, part = one
        # what uncertain starts do takes error away: it is asked for where the rest does not foresee the motion
        reduced = nearer.together(twin, [group], start_errors=False)
        if reduced is None or _foresees(part, reduced) or _foresees(part, reduced := reduced.with_start_errors()):
            return None
        return look(reduced)

    again = [found for found in concurrently_here(unforeseen, more) if found is not None]
    above = above_floor(again, [], seed, say, seen=True)
    found = {part.joints for _, part in above}
    outcomes[:] = [outcome for outcome in outcomes if outcome.joints not in found]
    return nearer, above + above_floor(concurrently_here(look, fresh), outcomes, seed, say), fresh


def _foresees(part: PartFit, near: Reduced) -> bool:
    """Whether a fit to clear motion leaves no more, with the motion near something, than asks for a closer look."""
    squares, counts = np.zeros(len(part.joints)), np.zeros(len(part.joints))
    for rows, piece in zip(part.held_out(part.base, near.train), near.train, strict=True):
        known = np.isfinite(piece.measured[:, [piece.joints.index(joint) for joint in part.joints]])
        squares, counts = squares + (np.where(known, rows, 0.0) ** 2).sum(axis=0), counts + known.sum(axis=0)
    return bool((squares <= CLOSER_LOOK * part.floor * counts).all())
