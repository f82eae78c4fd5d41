"""Messages into samples: joined by joint name, in the order of their stamps, with everything unusable counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.recordings.rows import Block, Rows

_MAX_JOINTS = 4096  # names that are made up by damaged or hostile messages must not fill the memory


@dataclass(frozen=True)
class Stream:
    """Samples of one topic: `stamp_ns` (n,) strictly increasing; values (n, j), NaN where not carried."""

    stamp_ns: np.ndarray
    joints: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray | None
    effort: np.ndarray | None
    merged: int
    by_receive_time: bool


def assemble(parts: Sequence[Rows], dropped: Counter[str], *, zero_is_unset: bool = True) -> Stream | None:
    """One stream from all kinds of messages of a topic; None if nothing usable is left.

    A stamp of zero means "not set" in ROS: where no message has one, receive times stand in for all of them.
    Each joint's stamps increase: a message that carries a joint again at the same stamp is a duplicate, at an earlier
    one it goes backward. Messages of one stamp with different joints become one sample.
    """
    taken = [(rows.names, block) for rows in parts if (block := rows.take()) is not None]
    by_receive_time = False
    if zero_is_unset:
        by_receive_time = bool(taken) and all(not block.stamp_ns.any() for _, block in taken)
        for _, block in taken:
            if by_receive_time:
                block.stamp_ns = block.received_ns
        taken = [(names, _keep(block, np.asarray(block.stamp_ns > 0), "no_stamp", dropped)) for names, block in taken]
    taken = [(names, _without_nan(block, dropped)) for names, block in taken]
    taken = [(names, block) for names, block in taken if len(block.stamp_ns)]
    taken = _in_order(taken, dropped)
    if not taken:
        return None
    if len(taken) == 1:
        names, block = taken[0]
        return Stream(block.stamp_ns, names, block.position, block.velocity, block.effort, 0, by_receive_time)
    return _joined(taken, by_receive_time)


def _keep(block: Block, rows: np.ndarray, kind: str, dropped: Counter[str]) -> Block:
    """The block with these rows only; the others are counted. No copy where all are kept."""
    lost = len(rows) - int(rows.sum())
    if not lost:
        return block
    dropped[kind] += lost
    return Block(
        block.stamp_ns[rows],
        block.received_ns[rows],
        block.order[rows],
        block.position[rows],
        None if block.velocity is None else block.velocity[rows],
        None if block.effort is None else block.effort[rows],
    )


def _without_nan(block: Block, dropped: Counter[str]) -> Block:
    """Values that are not finite become NaN, which means absent; a message without any position is dropped."""
    for kind, values in (("nan", block.position), ("velocity_nan", block.velocity), ("effort_nan", block.effort)):
        if values is None or _all_finite(values):
            continue
        bad = ~np.isfinite(values)
        if bad.any():
            dropped[kind] += int(bad.sum())
            values[bad] = np.nan
    if _all_finite(block.position):
        return block
    return _keep(block, np.asarray(np.isfinite(block.position).any(axis=1)), "all_nan", dropped)


def _all_finite(values: np.ndarray) -> bool:
    """Whether a cheap look shows that nothing is missing: a sum is finite only if all its terms are."""
    with np.errstate(all="ignore"):
        return bool(np.isfinite(values.sum()))


def _in_order(taken: list[tuple[tuple[str, ...], Block]], dropped: Counter[str]) -> list[tuple[tuple[str, ...], Block]]:
    """Only what lets the stamps of every joint increase strictly, in order of arrival."""
    carried = [name for names, _ in taken for name in names]
    if len(set(carried)) == len(carried):
        verdicts = [_judge_alone(block.stamp_ns) for _, block in taken]
    else:
        verdicts = _judge_together(taken)
    kept = []
    for (names, block), verdict in zip(taken, verdicts, strict=True):
        for kind, code in _CODES.items():
            if count := int((verdict == code).sum()):
                dropped[kind] += count
        # counted just above, kind by kind
        kept.append((names, _keep(block, verdict == _FINE, "", Counter())))
    return [(names, block) for names, block in kept if len(block.stamp_ns)]


_FINE = 0
_CODES = {"duplicate": 1, "backward": 2, "ahead": 3}


def _judge_alone(stamp_ns: np.ndarray) -> np.ndarray:
    """Verdict (n,) on the messages of one set of joints, whose stamps concern nobody else."""
    verdict = np.zeros(len(stamp_ns), dtype=np.int8)
    if (np.diff(stamp_ns) > 0).all():
        return verdict
    # One stamp from the future must not turn the whole rest of a recording into the past.
    ahead = np.zeros(len(stamp_ns), dtype=bool)
    if len(stamp_ns) >= 3:
        next_ns, after_ns = stamp_ns[1:-1], stamp_ns[2:]
        before_ns = np.concatenate([[np.iinfo(np.int64).min], stamp_ns[:-3]])
        later = np.minimum(next_ns, after_ns)
        ahead[:-2] = (stamp_ns[:-2] > np.maximum(next_ns, after_ns)) & (before_ns < later)
    verdict[ahead] = _CODES["ahead"]
    rest = stamp_ns[~ahead]
    latest = np.maximum.accumulate(rest)
    judged = np.zeros(len(rest), dtype=np.int8)
    judged[1:][rest[1:] == latest[:-1]] = _CODES["duplicate"]
    judged[1:][rest[1:] < latest[:-1]] = _CODES["backward"]
    verdict[~ahead] = judged
    return verdict


def _judge_together(taken: list[tuple[tuple[str, ...], Block]]) -> list[np.ndarray]:
    """Verdicts on messages whose sets of joints overlap: one by one, in order of arrival over all of them."""
    joints = _union(taken)
    columns = [np.array([joints[name] for name in names]) for names, _ in taken]
    verdicts = [np.zeros(len(block.stamp_ns), dtype=np.int8) for _, block in taken]
    finite = [np.isfinite(block.position) for _, block in taken]
    part = np.concatenate([np.full(len(block.order), index) for index, (_, block) in enumerate(taken)])
    row = np.concatenate([np.arange(len(block.order)) for _, block in taken])
    order = np.argsort(np.concatenate([block.order for _, block in taken]), kind="stable")
    latest = np.full(len(joints), np.iinfo(np.int64).min)
    for index, at in zip(part[order].tolist(), row[order].tolist(), strict=True):
        carried = columns[index][finite[index][at]]
        stamp_ns = taken[index][1].stamp_ns[at]
        newest = latest[carried].max()
        if stamp_ns > newest:
            latest[carried] = stamp_ns
        else:
            verdicts[index][at] = _CODES["duplicate" if stamp_ns == newest else "backward"]
    return verdicts


def _joined(taken: list[tuple[tuple[str, ...], Block]], by_receive_time: bool) -> Stream:
    joints = _union(taken)
    stamp_ns = np.unique(np.concatenate([block.stamp_ns for _, block in taken]))
    shape = (len(stamp_ns), len(joints))

    def spread(key: str) -> np.ndarray | None:
        if all(getattr(block, key) is None for _, block in taken):
            return None
        out = np.full(shape, np.nan)
        for names, block in taken:
            values = getattr(block, key)
            if values is None:
                continue
            rows = np.searchsorted(stamp_ns, block.stamp_ns)
            for column, name in enumerate(names):
                carried = np.isfinite(block.position[:, column])
                out[rows[carried], joints[name]] = values[carried, column]
        return out

    position = spread("position")
    assert position is not None
    merged = sum(len(block.stamp_ns) for _, block in taken) - len(stamp_ns)
    return Stream(stamp_ns, tuple(joints), position, spread("velocity"), spread("effort"), merged, by_receive_time)


def _union(taken: list[tuple[tuple[str, ...], Block]]) -> dict[str, int]:
    """Every joint with its column, in order of first appearance."""
    joints: dict[str, int] = {}
    for names, _ in taken:
        for name in names:
            joints.setdefault(name, len(joints))
    if len(joints) > _MAX_JOINTS:
        raise BadInput(f"its messages name {len(joints)} different joints", allowed=f"{_MAX_JOINTS} at most")
    return joints
