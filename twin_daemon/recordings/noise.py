"""How much of the error no model can explain: the sensor's noise and resolution."""

from __future__ import annotations

import math

import numpy as np

_ROUNDING_RAD = 1e-9
_COUNTS_MOVED = 4.0  # counts that a block has to travel, so that its readings change with every few samples
_LEAST_BLOCKS = 8
_ORDERS = (2, 3, 4, 5)


def noise_variance(values: np.ndarray) -> float:
    """Variance (rad^2) of the reading about the true angle, from one joint's samples (n,).

    Differences of the n-th order cancel the motion, the more so the higher the order: their mean square is (2n over n)
    times the noise variance, and what slow sampling leaves of fast motion in it only adds. So the order with the least
    counts. The median of short pieces is taken, so that impacts and steps do not count as noise. A quantised sensor at
    rest hides its noise within one count, so it is judged where it moves, and a resolution q counts with q^2/12 at
    least.
    """
    values = values[np.isfinite(values)]
    count = resolution(values)
    if values.size < 32:
        return count**2 / 12.0
    return min(_by_differences(values, order, count) for order in _ORDERS)


def _by_differences(values: np.ndarray, order: int, count: float) -> float:
    """rad^2 from the differences of one order of samples (n,) of a sensor that counts in steps of `count` rad."""
    squares = np.diff(values, n=order) ** 2 / math.comb(2 * order, order)
    edges = np.linspace(0, squares.size, max(8, squares.size // 25) + 1).astype(int)
    blocks = np.add.reduceat(squares, edges[:-1]) / np.diff(edges)
    if count > 0.0:
        beside = values[order // 2 : len(values) - (order + 1) // 2]
        travel = np.maximum.reduceat(beside, edges[:-1]) - np.minimum.reduceat(beside, edges[:-1])
        moved = blocks[travel > _COUNTS_MOVED * count]
        blocks = moved if len(moved) >= _LEAST_BLOCKS else blocks
    return float(max(np.median(blocks), count**2 / 12.0))


def resolution(values: np.ndarray) -> float:
    """The step (rad) in which a sensor counts, or 0 where its readings take nearly as many values as samples."""
    distinct = np.unique(values)
    if distinct.size < 2 or distinct.size > 0.5 * values.size:
        return 0.0
    gaps = np.diff(distinct)
    # most gaps are several counts wide where the joint was fast; spellings of one count differ by rounding
    return float(np.percentile(gaps[gaps > _ROUNDING_RAD], 10)) if (gaps > _ROUNDING_RAD).any() else 0.0
