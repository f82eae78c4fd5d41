"""Motion in which parts come near without a touch: looked at where all that is clear of any is at its floor."""

from __future__ import annotations

from collections.abc import Sequence

from twin_daemon.diagnosis.as_fitted import looked_at_again
from twin_daemon.diagnosis.conclude import Outcome
from twin_daemon.diagnosis.floor_check import above_floor
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.selection import Say
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.thresholds import LEAST_CLEAR_S
from twin_daemon.simulation.twin import TwinModel


def when_near(
    twin: TwinModel, reduction: Reduction, groups: Sequence[Reduced], outcomes: list[Outcome], seed: int, say: Say
) -> tuple[Reduction, list[tuple[Reduced, PartFit]]]:
    """(a reduction that leaves out only touches that readings show; the groups at which something is missing there).

    Neighbouring fingers pass each other within the millimetre that counts as a touch, half of the time. A reading that
    is off shows no touch where there is one, so that motion which is clear even then is asked first, and has to find
    nothing. What the groups that are found here said of that is taken out of `outcomes`.
    """
    nearer = reduction.where_near()
    more = [group for group in groups if nearer.clear_s(group.joints) > reduction.clear_s(group.joints) + LEAST_CLEAR_S]
    if not more:
        return reduction, []
    say(f"{', '.join(group.name for group in more)}: once more, with the motion in which something only comes near")
    above = above_floor(looked_at_again(twin, nearer, more), [], seed, say, seen=True)
    found = {part.joints for _, part in above}
    outcomes[:] = [outcome for outcome in outcomes if outcome.joints not in found]
    return nearer, above
