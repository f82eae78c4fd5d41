"""A sequential test for a change that lasts: the tabular CUSUM, with its alarms per time as the setting."""

from __future__ import annotations

import numpy as np

_MOST = 3.0  # one block may count for so many sigma: a single collision is not wear


def run_length(threshold: float, slack: float) -> float:
    """Mean number of blocks to a false alarm of a one-sided CUSUM of unit normal values.

    Siegmund, Sequential Analysis (1985), eq. 2.56 with the correction of 1.166 for the overshoot.
    """
    reach = threshold + 1.166
    return float((np.exp(2.0 * slack * reach) - 1.0 - 2.0 * slack * reach) / (2.0 * slack**2))


def threshold_for(blocks: float, slack: float) -> float:
    """The decision interval (sigma) at which a false alarm comes once in so many blocks on average."""
    low, high = -1.0, 200.0  # the run length grows with the threshold; the daemon starts without scipy
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if run_length(middle, slack) < max(blocks, 2.0) else (low, middle)
    return 0.5 * (low + high)


class Cusum:
    """Upper sums of k series at once (Page, Biometrika 41, 1954): S = max(0, S + z - slack)."""

    def __init__(self, series: int, slack: float, threshold: float) -> None:
        self.slack, self.threshold = slack, threshold
        self.sums = np.zeros(series)
        self.since_ns = np.zeros(series, dtype=np.int64)

    def add(self, stamp_ns: np.ndarray, deviations: np.ndarray) -> np.ndarray:
        """Takes deviations (k,) in sigma, NaN where there is none, of blocks that began at `stamp_ns` (k,).

        True (k,) where the test alarms.
        """
        known = np.isfinite(deviations)
        step = np.clip(np.where(known, deviations, 0.0), -_MOST, _MOST) - self.slack
        begins = known & (self.sums == 0.0)
        self.since_ns[begins] = stamp_ns[begins]
        self.sums = np.where(known, np.maximum(0.0, self.sums + step), self.sums)
        return self.sums > self.threshold
