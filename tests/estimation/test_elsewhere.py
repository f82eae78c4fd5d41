"""What values are known to elsewhere, where they may differ from those that were fitted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.estimation.uncertainty import elsewhere


@given(st.integers(0, 2**32 - 1))
def test_covariances_add(seed: int) -> None:
    random = np.random.default_rng(seed)
    slopes = random.normal(size=(9, 3))
    information, apart = slopes.T @ slopes + np.eye(3), random.uniform(0.0, 2.0, 3)
    expected = np.linalg.inv(np.linalg.inv(information) + np.diag(apart**2))
    assert elsewhere(information, apart) == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_what_nothing_is_known_of_stays_unknown() -> None:
    information = np.diag([4.0, 0.0])  # the second value was not excited, so that there is no covariance to add to
    assert elsewhere(information, np.array([0.5, 0.5])) == pytest.approx(np.diag([2.0, 0.0]))


def test_values_that_do_not_differ_are_as_sure_there() -> None:
    information = np.array([[2.0, 1.0], [1.0, 3.0]])
    assert elsewhere(information, np.zeros(2)) is information
