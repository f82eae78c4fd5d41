"""How long something took, the last times that it was done."""

from __future__ import annotations

from collections import deque

_KEPT = 2000


class Durations:
    """Written by one thread, read by any."""

    def __init__(self) -> None:
        self._kept_s: deque[float] = deque(maxlen=_KEPT)

    def add(self, seconds: float) -> None:
        self._kept_s.append(seconds)

    def told(self, what: str) -> dict[str, float | None]:
        """Median, 99th percentile and greatest of them, s; None while there are none."""
        ordered = sorted(self._kept_s.copy())
        places = {"p50": 0.5, "p99": 0.99, "max": 1.0}
        return {
            f"{what}_{name}_s": ordered[min(int(share * len(ordered)), len(ordered) - 1)] if ordered else None
            for name, share in places.items()
        }
