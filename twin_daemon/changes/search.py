"""What has changed since an earlier session: every group of joints, both sessions at once."""

from __future__ import annotations

from collections.abc import Sequence

from twin_daemon.changes.answer import Since
from twin_daemon.changes.conclude import conclude
from twin_daemon.changes.group_search import Believed, GroupFound, Sessions, search_group
from twin_daemon.changes.quantities import quantities
from twin_daemon.changes.thresholds import SPIKE
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.executor import side_by_side
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime, TimeLimit
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel


def changes_since(
    twin: TwinModel,
    baseline: Sequence[Aligned],
    now: Sequence[Aligned],
    held: Sequence[Aligned] = (),
    *,
    joints: Sequence[str] | None = None,
    believed: Believed | None = None,
    spread: float = SPIKE,
    seed: int = 0,
    stream: Say | None = None,
    limit: TimeLimit | None = None,
) -> Since:
    """What is another one in `now` than in `baseline`; where that is empty, than is `believed` of the twin's own.

    `held` is more motion of the later session, by which what was found is judged; `spread` how much a parameter differs
    between sessions without wear, one sigma of its logarithm. The end of the time limit and Ctrl-C
    end the search; what has been found until then is in the answer.
    """
    limit, say = limit or TimeLimit(), stream or (lambda _: None)
    moving = [name for name in moving_joints(now) if not joints or name in joints]
    if baseline:
        moved = moving_joints(baseline)
        moving = [name for name in moving if name in moved]
    reduction = Reduction(twin, baseline, [*now, *held]) if baseline else Reduction(twin, now, held)
    chosen = [(group, [name for name in moving if name in group.joints]) for group in drive_groups(twin)]
    chosen = [(group, own) for group, own in chosen if own]
    cut = [reduced for reduced in reduction.each(twin, chosen) if reduced is not None]
    usable = [(reduced, sessions) for reduced in cut if (sessions := _sessions(reduced, baseline, now)).now]
    touching = [group.name for group, _ in chosen if group.name not in {reduced.name for reduced, _ in usable}]
    candidates = sum(q.wears for reduced, _ in usable for q in quantities(reduced.twin, reduced.joints))
    found: list[GroupFound] = []
    interrupted = False

    def search(item: tuple[Reduced, Sessions], tell: Say) -> GroupFound:
        one = search_group(item[0], item[1], candidates, believed, spread)
        named = ", ".join(one.quantities[i].name for i in one.changed) or "no change"
        tell(f"{', '.join(one.joints)}: {named}")
        return one

    try:
        with limit.enforced():
            for _, one in side_by_side(search, usable, say):
                found.append(one)
    except (KeyboardInterrupt, OutOfTime):
        interrupted = True
    order = [reduced.name for reduced, _ in usable]
    found.sort(key=lambda one: order.index(one.name))
    return conclude(found, now, touching, seed, interrupted)


def _sessions(reduced: Reduced, baseline: Sequence[Aligned], now: Sequence[Aligned]) -> Sessions:
    """A group's pieces by the session that they come from."""
    pieces = (*reduced.train, *reduced.holdout)
    before = {r.recording.sha256 for r in baseline}
    later = {r.recording.sha256 for r in now} - before
    return Sessions(
        before=tuple(p for p in pieces if p.recording.sha256 in before),
        now=tuple(p for p in pieces if p.recording.sha256 in later),
        held=tuple(p for p in pieces if p.recording.sha256 not in before | later),
    )
