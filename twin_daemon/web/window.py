"""The last seconds of hand and twin, sample by sample, for charts that move."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

KEPT_S = 12.0
STATISTICS_S = 10.0
_MOST_SAMPLES = 12_000  # KEPT_S at 1 kHz
_MOST_PENDING = 256
_MOST_A_FRAME = 4


@dataclass(frozen=True)
class Piece:
    """Samples after a cursor: `time_s` (n,) since `base_ns`, measured and predicted (n, j) rad, NaN where unknown.
    `base_ns` is the stamp of the first sample since the stamps last started again.

    `cursor` is where the next piece begins. `fresh` says that what was sent before is no longer part of it.
    """

    cursor: int
    fresh: bool
    base_ns: int
    time_s: np.ndarray
    measured: np.ndarray
    predicted: np.ndarray


class Window:
    """Pairs of measured and predicted with the same stamp. Safe from several threads."""

    def __init__(self, joints: Sequence[str]) -> None:
        self.joints = tuple(joints)
        self._column = {name: index for index, name in enumerate(self.joints)}
        self._stamp_ns = np.zeros(_MOST_SAMPLES, np.int64)
        self._values = np.full((2, _MOST_SAMPLES, len(self.joints)), np.nan, np.float32)
        self._pending: OrderedDict[int, np.ndarray] = OrderedDict()
        self._lock = threading.Lock()
        self._count = 0
        self._begin = 0  # the first sample since the stamps last started again
        self._base_ns = 0  # its stamp, which outlives its place in the ring

    def measured(self, stamp_ns: int, names: Sequence[str], position: np.ndarray) -> None:
        """One joint state; it waits for its prediction. Names that the hand does not have are left out."""
        with self._lock:
            self._pending[stamp_ns] = self._in_order(names, position)
            if len(self._pending) > _MOST_PENDING:
                self._pending.popitem(last=False)

    def predicted(self, stamp_ns: int, names: Sequence[str], position: np.ndarray) -> None:
        """One prediction; with the joint state of its stamp it becomes a sample."""
        with self._lock:
            measured = self._pending.pop(stamp_ns, None)
            if measured is None:
                return
            if self._count > self._begin and stamp_ns <= self._stamp_ns[(self._count - 1) % _MOST_SAMPLES]:
                self._begin = self._count
            if self._count == self._begin:
                self._base_ns = stamp_ns
            at = self._count % _MOST_SAMPLES
            self._stamp_ns[at] = stamp_ns
            self._values[0, at], self._values[1, at] = measured, self._in_order(names, position)
            self._count += 1

    def after(self, cursor: int) -> Piece:
        """What came since a cursor, thinned to what a screen shows in one frame; of all that came with cursor 0.

        Of each stretch the sample with the largest residual is kept, so that no peak is lost.
        """
        with self._lock:
            first = max(self._begin, self._count - _MOST_SAMPLES, 0)
            fresh = cursor <= self._begin or cursor < first or cursor > self._count
            index = np.arange(first if fresh else cursor, self._count) % _MOST_SAMPLES
            if len(index):
                index = index[self._stamp_ns[index] > self._stamp_ns[index[-1]] - KEPT_S * 1e9]
            frames = 20.0 * KEPT_S if fresh else 1.0
            index = index[self._thinned(index, int(frames * _MOST_A_FRAME))]
            return Piece(
                cursor=self._count,
                fresh=fresh,
                base_ns=self._base_ns,
                time_s=(self._stamp_ns[index] - self._base_ns) * 1e-9,
                measured=self._values[0, index],
                predicted=self._values[1, index],
            )

    def rms_rad(self) -> np.ndarray:
        """(j,) rms residual over the last seconds; NaN where nothing is known."""
        with self._lock:
            index = np.arange(max(self._begin, self._count - _MOST_SAMPLES, 0), self._count) % _MOST_SAMPLES
            if not len(index):
                return np.full(len(self.joints), np.nan)
            index = index[self._stamp_ns[index] > self._stamp_ns[index[-1]] - STATISTICS_S * 1e9]
            residual = self._values[0, index].astype(float) - self._values[1, index]
        known = np.isfinite(residual)
        total = np.sum(np.where(known, residual, 0.0) ** 2, axis=0)
        return np.sqrt(np.divide(total, known.sum(axis=0), out=np.full(len(total), np.nan), where=known.any(axis=0)))

    def _thinned(self, index: np.ndarray, most: int) -> np.ndarray:
        if len(index) <= most:
            return np.arange(len(index))
        worst = np.nan_to_num(np.abs(self._values[0, index] - self._values[1, index])).max(axis=1)
        edges = np.linspace(0, len(index), most + 1).astype(int)
        return np.array([start + int(np.argmax(worst[start:stop])) for start, stop in pairwise(edges)])

    def _in_order(self, names: Sequence[str], position: np.ndarray) -> np.ndarray:
        row = np.full(len(self.joints), np.nan, np.float32)
        if len(names) == len(position):
            for name, value in zip(names, position.tolist(), strict=True):
                if (column := self._column.get(name)) is not None:
                    row[column] = value
        return row
