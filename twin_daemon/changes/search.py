"""What has changed since an earlier session: every group of joints, both sessions at once."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

from twin_daemon.changes.answer import Since
from twin_daemon.changes.conclude import conclude
from twin_daemon.changes.diagnosed import changed_together, diagnosed
from twin_daemon.changes.group import Begun, Believed, Group, Sessions, begun, group_of
from twin_daemon.changes.group_search import GroupFound, search_group
from twin_daemon.changes.quantities import Quantity, quantities
from twin_daemon.changes.thresholds import COLD_TO_WARM, LEFT_OVER, SPIKE
from twin_daemon.diagnosis.left_out import LeftOut
from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.executor import in_order, side_by_side
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime, TimeLimit
from twin_daemon.simulation.alignment import Aligned, judged_joints, moving_joints, unanswering_joints
from twin_daemon.simulation.submodel import Part, drive_groups
from twin_daemon.simulation.twin import TwinModel

_Chosen = tuple[Part, list[str]]
"""A group of a twin, with those of its joints that are looked at."""


def changes_since(
    twin: TwinModel,
    baseline: Sequence[Aligned],
    now: Sequence[Aligned],
    held: Sequence[Aligned] = (),
    *,
    joints: Sequence[str] | None = None,
    believed: Believed | None = None,
    spread: float = SPIKE,
    warmed: float = COLD_TO_WARM,
    seed: int = 0,
    stream: Say | None = None,
    limit: TimeLimit | None = None,
) -> Since:
    """What is another one in `now` than in `baseline`; where that is empty, than is `believed` of the twin's own.

    `held` is more motion of the later session, by which what was found is judged; `spread` how much a parameter differs
    between sessions without wear, one sigma of its logarithm; `warmed` by how many standard deviations of the
    temperature sessions may differ. The end of the time limit and Ctrl-C end the search; what has been found until
    then is in the answer.
    """
    limit, say = limit or TimeLimit(), stream or (lambda _: None)
    moving = [name for name in judged_joints(twin, now) if not joints or name in joints]
    if baseline:
        moved = moving_joints(baseline)
        moving = [name for name in moving if name in moved]
    reduction = Reduction(twin, baseline, [*now, *held]) if baseline else Reduction(twin, now, held)
    chosen = [(group, [name for name in moving if name in group.joints]) for group in drive_groups(twin)]
    chosen = [(group, own) for group, own in chosen if own]
    usable = _cut(twin, reduction, chosen, baseline, now)
    unseen = _not_among(chosen, usable)
    nearer = _cut(twin, reduction.where_near(), unseen, baseline, now) if unseen else []
    near = [reduced.name for reduced, _ in nearer]
    usable = [*usable, *nearer]
    touching = {group.name: tuple(own) for group, own in _not_among(chosen, usable)}
    each = [quantities(reduced.twin, reduced.joints, spread) for reduced, _ in usable]
    candidates = sum(q.wears for every in each for q in every)
    found: list[GroupFound] = []
    told: list[Diagnosis] = []
    interrupted = False

    def begin(item: tuple[Reduced, Sessions, tuple[Quantity, ...], Mapping[str, float]], _: Say) -> Begun:
        reduced, sessions, every, values = item
        return begun(reduced, sessions, every, believed, values)

    def open_up(one: Begun, _: Say) -> Group:
        return group_of(one)

    def search(group: Group, tell: Say) -> GroupFound:
        one = search_group(group, candidates)
        named = ", ".join(one.quantities[i].name for i in one.changed) or "no change"
        tell(f"{', '.join(one.joints)}: {named}")
        return one

    try:
        with limit.enforced():
            first = in_order(begin, [(*group, every, {}) for group, every in zip(usable, each, strict=True)], say)
            cut = [(part, _sessions(part, baseline, now), one) for one, part in _closer(twin, reduction, near, first)]
            anew = [
                (part, both, one.pair.now.quantities, one.values) for part, both, one in cut if both.before and both.now
            ]
            closer = {one.reduced.name: one for one in in_order(begin, anew, say)}
            first = [closer.get(one.reduced.name, one) for one in first]
            groups = in_order(open_up, first, say)
            for together in changed_together(twin, groups):
                one = diagnosed(twin, together, now, held, spread, seed, say, limit)
                # what each of them may have alone is asked for group by group
                if one is not None and any(_is_shared(finding, together) for finding in one.findings):
                    told.append(one)
                    groups = [group for group in groups if group not in together]
            for _, one in side_by_side(search, groups, say):
                found.append(one)
            for unexplained in [one for one in found if one.left > LEFT_OVER]:
                own = [group for group in groups if group.pair.now.joints == unexplained.joints]
                other = diagnosed(twin, own, now, held, spread, seed, say, limit)
                if other is not None:
                    told.append(other)
                    found = [one for one in found if one is not unexplained]
    except (KeyboardInterrupt, OutOfTime):
        interrupted = True
    order = list(twin.joints)
    found.sort(key=lambda one: order.index(one.joints[0]))
    left_out = LeftOut(
        touching, near=near, unanswering=[name for name in unanswering_joints(twin, now) if name in moving]
    )
    return conclude(found, told, now, left_out, seed, interrupted, warmed)


def _cut(
    twin: TwinModel,
    reduction: Reduction,
    chosen: Sequence[_Chosen],
    baseline: Sequence[Aligned],
    now: Sequence[Aligned],
) -> list[tuple[Reduced, Sessions]]:
    """The groups of which a reduction leaves enough motion of both sessions, with it."""
    cut = [reduced for reduced in reduction.each(twin, chosen) if reduced is not None]
    return [(reduced, sessions) for reduced in cut if (sessions := _sessions(reduced, baseline, now)).now]


def _not_among(chosen: Sequence[_Chosen], usable: Sequence[tuple[Reduced, Sessions]]) -> list[_Chosen]:
    seen = {reduced.name for reduced, _ in usable}
    return [(group, own) for group, own in chosen if group.name not in seen]


def _closer(
    twin: TwinModel, reduction: Reduction, near: Collection[str], groups: Sequence[Begun]
) -> list[tuple[Begun, Reduced]]:
    """Those that their earlier session's fit leaves off, cut anew where the others move as they have been fitted.

    A model that is off makes another motion of a fast one when it smooths what was measured, so that what it takes the
    others to do to a neighbour is wrong; and its time step's error is another one. Those that are `near` something all
    the time are cut as they were.
    """
    off = [one for one in groups if one.is_off]
    if not off:
        return []
    values = dict(twin.terms.parameters)
    for one in groups:
        values |= one.values
    closer = reduction.following(twin.changed(twin.terms.model_copy(update={"parameters": values})))
    nearer = closer.where_near()
    cut = [(one, (nearer if one.reduced.name in near else closer).anew(twin, one.reduced)) for one in off]
    return [(one, part) for one, part in cut if part is not None]


def _is_shared(finding: Finding, groups: Sequence[Group]) -> bool:
    return sum(bool(set(finding.joints) & set(group.reduced.joints)) for group in groups) > 1


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
