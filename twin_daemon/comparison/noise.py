"""How much of the error no model can explain: the sensor's noise and resolution."""

from __future__ import annotations

import numpy as np

_ROUNDING_RAD = 1e-9
_COUNTS_MOVED = 4.0  # counts that a block has to travel, so that its readings change with every few samples
_LEAST_BLOCKS = 8


def noise_variance(values: np.ndarray) -> float:
    """Variance (rad^2) of the reading about the true angle, from one joint's samples (n,).

    Second differences cancel the motion: their mean square is 6 times the noise variance. They are taken over
    the quietest half of the recording, so that impacts and steps do not count as noise. A quantised sensor at
    rest hides its noise within one count, so it is judged where it moves, and a resolution q counts with q^2/12 at
    least.
    """
    values = values[np.isfinite(values)]
    if values.size < 32:
        return resolution(values) ** 2 / 12.0
    squares = np.diff(values, n=2) ** 2
    pieces = max(8, squares.size // 25)
    blocks = np.array([block.mean() for block in np.array_split(squares, pieces)])
    count = resolution(values)
    if count > 0.0:
        travel = np.array([np.ptp(block) for block in np.array_split(values[1:-1], pieces)])
        moved = blocks[travel > _COUNTS_MOVED * count]
        blocks = moved if len(moved) >= _LEAST_BLOCKS else blocks
    lowest = np.sort(blocks)[: max(1, len(blocks) // 2)]
    return float(max(lowest.mean() / 6.0, count**2 / 12.0))


def resolution(values: np.ndarray) -> float:
    """The step (rad) in which a sensor counts, or 0 where its readings take nearly as many values as samples."""
    distinct = np.unique(values)
    if distinct.size < 2 or distinct.size > 0.5 * values.size:
        return 0.0
    gaps = np.diff(distinct)
    # most gaps are several counts wide where the joint was fast; spellings of one count differ by rounding
    return float(np.percentile(gaps[gaps > _ROUNDING_RAD], 10)) if (gaps > _ROUNDING_RAD).any() else 0.0
