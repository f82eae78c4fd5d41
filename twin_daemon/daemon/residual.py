"""Running statistics of the residual (measured minus predicted), exact over a window, at constant cost."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np


@dataclass
class _Block:
    """Sums over one second of data; every array is (j,)."""

    start_ns: int
    count: np.ndarray
    total: np.ndarray
    squares: np.ndarray
    largest: np.ndarray


@dataclass(frozen=True)
class ResidualStatistics:
    """Over the window, each (j,): NaN where a joint has no samples. rad and rad^2."""

    samples: np.ndarray
    bias_rad: np.ndarray
    mse_rad2: np.ndarray
    max_abs_rad: np.ndarray

    @property
    def rmse_rad(self) -> np.ndarray:
        return np.sqrt(self.mse_rad2)


class Residual:
    """Keeps the last residual and the sums of whole seconds, of which the window is made."""

    def __init__(self, joints: int, window_s: float) -> None:
        self._joints = joints
        self._window_ns = int(window_s * 1e9)
        self.clear()

    def clear(self) -> None:
        self.last_rad = np.full(self._joints, np.nan)
        self._blocks: deque[_Block] = deque()

    def add(self, stamp_ns: int, residual_rad: np.ndarray) -> None:
        """Takes one residual (j,); NaN means that the joint was not measured in this sample."""
        if not self._blocks or stamp_ns - self._blocks[-1].start_ns >= 1_000_000_000:
            zeros = np.zeros(self._joints)
            self._blocks.append(_Block(stamp_ns, zeros.copy(), zeros.copy(), zeros.copy(), zeros.copy()))
        while stamp_ns - self._blocks[0].start_ns > self._window_ns:
            self._blocks.popleft()
        block = self._blocks[-1]
        known = np.isfinite(residual_rad)
        value = np.where(known, residual_rad, 0.0)
        block.count += known
        block.total += value
        block.squares += value * value
        np.maximum(block.largest, np.abs(value), out=block.largest)
        self.last_rad = np.where(known, residual_rad, self.last_rad)

    def statistics(self) -> ResidualStatistics:
        count = np.zeros(self._joints)
        total, squares, largest = count.copy(), count.copy(), count.copy()
        for block in self._blocks:
            count += block.count
            total += block.total
            squares += block.squares
            np.maximum(largest, block.largest, out=largest)
        seen = count > 0
        safe = np.where(seen, count, 1.0)
        return ResidualStatistics(
            samples=count.astype(int),
            bias_rad=np.where(seen, total / safe, np.nan),
            mse_rad2=np.where(seen, squares / safe, np.nan),
            max_abs_rad=np.where(seen, largest, np.nan),
        )
