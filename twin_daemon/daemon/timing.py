"""The hand's clock seen from here: its offset, its jitter, its rate, and what did not arrive."""

from __future__ import annotations

import statistics
from collections import Counter, deque
from typing import Any, Literal

_KEPT = 512
_LEARNT = 32  # intervals before a rate is believed
_RELEARNT = 64
_STEADY = 8  # intervals in a row that are longer, and alike: another rate, and nothing is missing
_JUMP_NS = 500_000_000
_LATE_PERIODS, _LATEST_NS = 5.0, 50_000_000
_LONGEST_GAP_NS = 10_000_000_000  # a longer silence is a pause, not lost messages


class Timing:
    """Follows the stamps of one stream beside the times of their arrival.

    The offset is arrival minus stamp: the difference of the clocks and the transport together, which one stream
    cannot tell apart. Its least value lately is the transport at its fastest; what comes much later is `late`.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.forget()

    def forget(self) -> None:
        """The stream starts again; what was counted stays."""
        self._intervals: deque[int] = deque(maxlen=_KEPT)
        self._offsets: deque[int] = deque(maxlen=_KEPT)
        self._least_offset = 0
        self._last: tuple[int, int] | None = None
        self._period_ns: float | None = None
        self._until_relearnt = _LEARNT
        self._longer: list[int] = []

    def add(self, stamp_ns: int, arrival_ns: int) -> Literal["clock_jump"] | None:
        """Takes one accepted stamp and when it arrived (both ns). Says so where the hand's clock was set."""
        last, self._last = self._last, (stamp_ns, arrival_ns)
        offset = arrival_ns - stamp_ns
        if last is None:
            self._keep(offset)
            return None
        interval, waited = stamp_ns - last[0], arrival_ns - last[1]
        if abs(interval - waited) > _JUMP_NS and self._came_in_step(interval, waited):
            self.counts["clock_jumps"] += 1
            self._offsets.clear()
            self._keep(offset)
            return "clock_jump"
        self._count(interval, offset)
        self._intervals.append(interval)
        self._keep(offset)
        self._until_relearnt -= 1
        if self._until_relearnt <= 0:
            self._period_ns = statistics.median(self._intervals)
            self._until_relearnt = _RELEARNT
        return None

    def _keep(self, offset: int) -> None:
        offsets = self._offsets
        leaving = offsets[0] if len(offsets) == _KEPT else None
        offsets.append(offset)
        if leaving == self._least_offset or len(offsets) == 1:
            self._least_offset = min(offsets)
        elif offset < self._least_offset:
            self._least_offset = offset

    def _came_in_step(self, interval: int, waited: int) -> bool:
        """Whether the message came when it was due, whatever its stamp says; a burst after a stall did not."""
        return self._period_ns is not None and waited < max(_LATE_PERIODS * self._period_ns, _LATEST_NS) and (
            interval > _JUMP_NS
        )  # fmt: skip

    def _count(self, interval: int, offset: int) -> None:
        if self._period_ns is None:
            return
        if 1.5 * self._period_ns < interval < _LONGEST_GAP_NS:
            self._longer.append(interval)
            if len(self._longer) >= _STEADY and max(self._longer) < 1.2 * min(self._longer):
                self._period_ns = statistics.median(self._longer)
                self._intervals.clear()
                self._longer.clear()
        if len(self._longer) >= _STEADY or interval <= 1.5 * self._period_ns:
            self.counts["gaps"] += len(self._longer)
            self.counts["missing"] += sum(round(longer / self._period_ns) - 1 for longer in self._longer)
            self._longer.clear()
        if offset - self._least_offset > max(_LATE_PERIODS * self._period_ns, _LATEST_NS):
            self.counts["late"] += 1

    def as_json(self) -> dict[str, Any]:
        """Rate, offset and jitter of the last messages; null before there are enough."""
        offsets = sorted(self._offsets)
        middle = offsets[len(offsets) // 2] if offsets else None
        return {
            "rate_hz": 1e9 / self._period_ns if self._period_ns else None,
            "offset_s": None if middle is None else middle * 1e-9,
            "jitter_s": (offsets[int(0.99 * (len(offsets) - 1))] - offsets[0]) * 1e-9 if len(offsets) > 1 else None,
            **{kind: self.counts[kind] for kind in ("missing", "gaps", "late", "clock_jumps")},
        }
