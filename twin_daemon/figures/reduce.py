"""Fewer points for the screen, with every extreme kept."""

from __future__ import annotations

from itertools import pairwise

import numpy as np


def keep_extremes(values: np.ndarray, buckets: int) -> np.ndarray:
    """The samples (m,) of (n, k) curves that a drawing of so many buckets needs, in order.

    Of every bucket the lowest and the highest sample of each curve, and the first and last sample of all: no peak,
    dip or jump is lost, whatever its length. NaN counts as no extreme. At most 2 k samples a bucket; all of them
    where that would not be fewer.
    """
    samples, curves = values.shape
    if samples <= 2 * curves * buckets:
        return np.arange(samples)
    edges = np.linspace(0, samples, buckets + 1).astype(int)
    kept = [np.array([0, samples - 1])]
    for start, stop in pairwise(edges):
        part = values[start:stop]
        known = np.isfinite(part)
        kept.append(start + np.argmin(np.where(known, part, np.inf), axis=0))
        kept.append(start + np.argmax(np.where(known, part, -np.inf), axis=0))
    return np.unique(np.concatenate(kept))
