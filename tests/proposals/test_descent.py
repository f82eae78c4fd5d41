"""A descent over a cost with corners, as what sticks and slips makes them."""

from __future__ import annotations

import numpy as np
import pytest

from twin_daemon.proposals.descent import gauss_newton


class _Corner:
    """One row that falls to the left of 0.5, and to the right of it for less than any step."""

    def residuals(self, points: np.ndarray) -> np.ndarray:
        gone = points[:, 0] - 0.5
        dip = np.where(gone < 0.005, -gone, -0.005 + 20.0 * (gone - 0.005))
        return 1.0 + np.where(gone <= 0.0, 2.0 * gone, dip)[:, None]


def test_a_descent_that_a_corner_stops_looks_to_the_other_side() -> None:
    assert gauss_newton(_Corner(), np.array([0.5]), 0, 3).point == pytest.approx(0.0, abs=1e-6)
