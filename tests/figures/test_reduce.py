"""Reducing for the screen never loses an extreme."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.figures.reduce import keep_extremes


@given(st.integers(1, 3000), st.integers(1, 3), st.integers(1, 50), st.integers(0, 2**32 - 1))
def test_every_extreme_of_every_curve_is_kept(samples: int, curves: int, buckets: int, seed: int) -> None:
    values = np.random.default_rng(seed).standard_normal((samples, curves))
    kept = keep_extremes(values, buckets)
    assert (np.diff(kept) > 0).all()
    assert kept[0] == 0
    assert kept[-1] == samples - 1
    assert len(kept) <= max(2 * curves * buckets + 2, 1)
    assert (values[kept].max(axis=0) == values.max(axis=0)).all()
    assert (values[kept].min(axis=0) == values.min(axis=0)).all()


def test_a_spike_of_one_sample_in_ten_minutes_is_kept() -> None:
    values = np.zeros((600_000, 1))
    values[345_678] = 1e-3
    assert 345_678 in keep_extremes(values, 100)


def test_what_is_not_measured_hides_no_extreme() -> None:
    values = np.full((1000, 1), np.nan)
    values[500:510] = np.arange(10.0)[:, None]
    kept = keep_extremes(values, 4)
    assert {500, 509} <= set(kept)


def test_few_samples_all_stay() -> None:
    assert list(keep_extremes(np.zeros((7, 2)), 10)) == list(range(7))
