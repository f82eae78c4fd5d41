"""A version that was taken up while the daemon runs has to keep what it promised, or it is rolled back."""

from __future__ import annotations

from dataclasses import dataclass

_LEAST_SAMPLES = 300
_IN_ROW = 3


@dataclass(frozen=True)
class Live:
    """The running statistics of a version: mean squared residual in rad^2 over the joints seen, and samples."""

    mse_rad2: float
    samples: int


class Probation:
    """Judges a version by its live residual for `duration_s` after it was taken up.

    Its error must not be `worse` times the greater of what it promised and what the version before it showed live at
    the end: a motion that is harder than the one it was judged on is hard for both. Three looks in a row count.
    """

    def __init__(self, duration_s: float, worse: float) -> None:
        self._duration_s = duration_s
        self._worse = worse
        self._version: str | None = None
        self._until_s = -float("inf")
        self._bound_rad2 = float("inf")
        self._in_row = 0

    def begin(self, version: str, promised_rad2: float | None, before: Live, now_s: float) -> None:
        """`version` has been taken up; `before` is what its predecessor showed."""
        known = [value for value in (promised_rad2, before.mse_rad2 if before.samples else None) if value]
        self._bound_rad2 = self._worse * max(known) if known else float("inf")
        self._version, self._until_s, self._in_row = version, now_s + self._duration_s, 0

    def failed(self, live: Live, now_s: float) -> tuple[str, float, float] | None:
        """(version, its live error, the bound), both in rad^2, when it has failed; then it is no longer watched."""
        if self._version is None or now_s > self._until_s or live.samples < _LEAST_SAMPLES:
            return None
        self._in_row = self._in_row + 1 if live.mse_rad2 > self._bound_rad2 else 0
        if self._in_row < _IN_ROW:
            return None
        version, self._version = self._version, None
        return version, live.mse_rad2, self._bound_rad2
