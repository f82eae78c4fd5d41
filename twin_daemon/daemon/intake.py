"""The border control of the daemon: nothing unchecked gets near the model, and everything refused is counted."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.one_source import Doubt, OneSource
from twin_daemon.daemon.stamps import StampOrder
from twin_daemon.hand.naming import match
from twin_daemon.simulation.twin import TwinModel

MAX_NAMES = 256
_KEPT_NAMES = 32
_MAX_LAYOUTS = 64
_LARGEST = np.finfo(float).max


@dataclass(frozen=True)
class Accepted:
    """The usable part of a joint state: `index` (k,) into the twin's joints, ascending, `position` (k,) rad."""

    stamp_ns: int
    index: np.ndarray
    position: np.ndarray
    restarted: bool = False


@dataclass(frozen=True)
class _Layout:
    """Which columns of messages with certain names are the twin's joints."""

    columns: np.ndarray
    index: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    unknown: tuple[str, ...]
    ambiguous: bool


class Intake:
    """Validates decoded joint states of one stream.

    A value that cannot be right (not finite, or more than `margin_rad` beyond its joint's range) costs only its own
    joint, which then goes stale; a message that contradicts itself is refused as a whole.
    """

    def __init__(self, joints: Sequence[str], lower: np.ndarray, upper: np.ndarray, margin_rad: float = 1.0) -> None:
        self._joints = tuple(joints)
        # finite where the joint has no limit, so that what is not finite is never inside
        self._lower = np.maximum(np.asarray(lower, float) - margin_rad, -_LARGEST)
        self._upper = np.minimum(np.asarray(upper, float) + margin_rad, _LARGEST)
        self._layouts: dict[tuple[str, ...], _Layout] = {}
        self._order = StampOrder()
        self._sources = OneSource()
        self._doubts: list[Doubt] = []
        self.received = 0
        self.accepted = 0
        self.counts: Counter[str] = Counter()
        self.unknown_names: set[str] = set()

    def refuse(self, kind: str) -> None:
        """Counts a message that did not even decode."""
        self.received += 1
        self.counts[kind] += 1

    def accept(self, sample: JointSample, arrival_ns: int, now_s: float | None = None) -> Accepted | None:
        """The part of a message that can be used, or None. `arrival_ns` stands in for an empty stamp, and for `now_s`
        on a monotonic clock."""
        now_s = arrival_ns * 1e-9 if now_s is None else now_s
        self.received += 1
        layout = self._check_shape(sample)
        if layout is None:
            return None
        position = np.asarray(sample.position, float)[layout.columns]
        usable = (position >= layout.lower) & (position <= layout.upper)
        index = layout.index
        if np.count_nonzero(usable) < len(usable):
            finite = np.isfinite(position)
            if not finite.all():
                self.counts["not_finite"] += 1
            if (finite & ~usable).any():
                self.counts["out_of_range"] += 1
            if not usable.any():
                return None
            index, position = index[usable], position[usable]
        doubt = self._sources.doubt(sample.source, now_s)
        if doubt is not None:
            self.counts[doubt.kind] += 1
            self._doubts.append(doubt)
            if doubt.kind == "second_source":
                return None
        stamp_ns = sample.stamp_ns
        if stamp_ns == 0:
            self.counts["no_stamp"] += 1
            stamp_ns = arrival_ns
        verdict = self._order.judge(stamp_ns)
        if verdict in ("duplicate_stamp", "backwards_stamp"):
            self.counts[verdict] += 1
            if verdict == "backwards_stamp":
                back_ns = self._order.last_ns - stamp_ns
                self._doubts.append(self._sources.backwards(sample.source, back_ns, now_s))
            return None
        if verdict == "restarted":
            self.counts["stamps_restarted"] += 1
        self.accepted += 1
        return Accepted(stamp_ns, index, position, restarted=verdict == "restarted")

    def take_doubts(self) -> list[Doubt]:
        """What has been wrong with the source of the states since the last call."""
        taken, self._doubts = self._doubts, []
        return taken

    def _check_shape(self, sample: JointSample) -> _Layout | None:
        count = len(sample.names)
        if not 0 < count <= MAX_NAMES or sample.stamp_ns < 0:
            self.counts["empty" if not sample.names else "malformed"] += 1
            return None
        extras = len(sample.velocity), len(sample.effort)
        if len(sample.position) != count or not {*extras} <= {0, count}:
            self.counts["length_mismatch"] += 1
            return None
        layout = self._layout(sample.names)
        if layout.ambiguous:
            self.counts["duplicate_names"] += 1
            return None
        if layout.unknown:
            self.counts["unknown_names"] += 1
            for name in layout.unknown:
                if len(self.unknown_names) < _KEPT_NAMES:
                    self.unknown_names.add(name[:64])
        if not layout.columns.size:
            return None
        return layout

    def _layout(self, names: tuple[str, ...]) -> _Layout:
        known = self._layouts.get(names)
        if known is not None:
            return known
        found, unknown = [], []
        for column, name in enumerate(names):
            joint = match(name, self._joints)
            if joint is None:
                unknown.append(name)
            else:
                found.append((self._joints.index(joint), column))
        index = np.array([joint for joint, _ in sorted(found)], dtype=int)
        columns = np.array([column for _, column in sorted(found)], dtype=int)
        ambiguous = len(set(index.tolist())) < len(index)
        layout = _Layout(columns, index, self._lower[index], self._upper[index], tuple(unknown), ambiguous)
        if len(self._layouts) >= _MAX_LAYOUTS:
            self._layouts.clear()  # a sender that invents names must not fill the memory
        self._layouts[names] = layout
        return layout


def wrong_with(sample: JointSample) -> str | None:
    """What is wrong with a command, by kind; None where nothing is."""
    if not sample.names:
        return "empty"
    if len(sample.names) > MAX_NAMES or sample.stamp_ns < 0:
        return "malformed"
    if len(sample.position) != len(sample.names):
        return "length_mismatch"
    if len(set(sample.names)) < len(sample.names):
        return "duplicate_names"
    finite = sample.position[np.isfinite(sample.position)]
    return "out_of_range" if (np.abs(finite) > 100.0).any() else None


def joint_ranges(twin: TwinModel) -> tuple[np.ndarray, np.ndarray]:
    """((j,), (j,)) rad: the range of each joint, infinite where it has no limit."""
    ranges = np.array([twin.hand.joint_range_rad.get(name, (-np.inf, np.inf)) for name in twin.joints])
    return ranges[:, 0], ranges[:, 1]
