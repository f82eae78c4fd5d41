"""How good a recording is: its timing, and everything that had to be left out of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, TypedDict

import numpy as np

# Kinds of `dropped` that count single values of a message whose rest was kept; all others count whole messages.
VALUE_KINDS = frozenset({"nan", "velocity_nan", "effort_nan", "velocity_wrong_length", "effort_wrong_length"})
_GAP_INTERVALS = 3.0  # an interval that is this many times the usual one is a gap


class Timing(TypedDict):
    """The part of Quality that follows from the stamps alone."""

    samples: int
    duration_s: float
    rate_hz: float | None
    jitter_s: float | None
    gaps: int
    longest_gap_s: float


@dataclass(frozen=True)
class Quality:
    """Timing of the samples that were kept, and counts of what was not.

    `rate_hz` is the inverse of the median interval, `jitter_s` the standard deviation of the intervals without gaps,
    a gap an interval of more than three usual ones. `messages` is how many were found: it equals `samples` + `merged`
    + the dropped messages. `merged` messages share the stamp of another one and carry other joints, so they became
    one sample with it. "ahead" is a single stamp from the future, after which the clock went on as before. The kinds
    in VALUE_KINDS count values (or arrays) left out of messages that were kept.
    """

    samples: int
    duration_s: float
    rate_hz: float | None
    jitter_s: float | None
    gaps: int
    longest_gap_s: float
    messages: int
    merged: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    commands_dropped: Mapping[str, int] = field(default_factory=dict)
    source: str = ""
    measured_topic: str | None = None
    command_topics: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def dropped_messages(self) -> int:
        """How many messages were left out as a whole."""
        return sum(count for kind, count in self.dropped.items() if kind not in VALUE_KINDS)

    def as_dict(self) -> dict[str, Any]:
        """The same as plain JSON types."""
        plain = asdict(self)
        plain["dropped"], plain["commands_dropped"] = dict(self.dropped), dict(self.commands_dropped)
        plain["command_topics"], plain["notes"] = list(self.command_topics), list(self.notes)
        return plain


def measure_timing(stamp_ns: np.ndarray) -> Timing:
    """Timing of strictly increasing stamps (n,) ns. Rate and jitter of a single sample are unknown (None)."""
    intervals_s = np.diff(stamp_ns) * 1e-9
    timing = Timing(
        samples=len(stamp_ns),
        duration_s=float(intervals_s.sum()),
        rate_hz=None,
        jitter_s=None,
        gaps=0,
        longest_gap_s=0.0,
    )
    if intervals_s.size:
        usual = float(np.median(intervals_s))
        gap = intervals_s > _GAP_INTERVALS * usual
        timing["rate_hz"] = 1.0 / usual
        timing["jitter_s"] = float(intervals_s[~gap].std())
        timing["gaps"] = int(gap.sum())
        timing["longest_gap_s"] = float(intervals_s[gap].max()) if gap.any() else 0.0
    return timing
