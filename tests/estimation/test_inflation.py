"""How much wider a value's interval is for what a fit leaves that is no noise."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.estimation.uncertainty import inflation


@given(st.floats(0.0, 1.0), st.floats(1.0, 1e6), st.integers(0, 40))
def test_noise_of_the_size_assumed_widens_nothing(left: float, samples: float, fitted: int) -> None:
    assert inflation(left, samples, fitted) == 1.0


@given(st.floats(1.5, 100.0), st.floats(1e4, 1e6), st.integers(1, 40))
def test_more_of_the_same_motion_makes_a_wrong_form_no_surer(left: float, samples: float, fitted: int) -> None:
    """The variance by noise falls as the samples grow in number, and what it is inflated by grows as much."""
    once, twice = (inflation(left, n, fitted) / n for n in (samples, 2.0 * samples))
    assert twice == pytest.approx(once, rel=0.01)
