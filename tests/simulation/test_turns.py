"""What bristles remember: where joints turned, and how far that has bent them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.simulation.turns import Turns, turning_points

_NOISE_RAD = 1e-4
_WAY_RAD = 0.05


@given(st.lists(st.floats(0.02, 0.5), min_size=1, max_size=8), st.integers(0, 2**32 - 1))
def test_turns_are_found_where_a_noisy_joint_turns(ways: list[float], seed: int) -> None:
    corners = np.cumsum([0.3, *(way * (-1) ** number for number, way in enumerate(ways))])
    legs = [np.linspace(a, b, 40, endpoint=False) for a, b in itertools.pairwise(corners)]
    angle = np.concatenate([*legs, corners[-1:]])
    angle += _NOISE_RAD * np.random.default_rng(seed).standard_normal(len(angle))
    angle[:: len(angle) // 3][1:] = np.nan  # some samples are missing
    found = turning_points(angle, 8 * _NOISE_RAD)
    np.testing.assert_allclose(angle[found], corners[:-1], atol=0.02)
    assert len(found) == len(ways)


def test_a_joint_that_is_never_seen_turns_nowhere() -> None:
    assert turning_points(np.full(9, np.nan), 0.01) == []


def test_bristles_are_bent_as_dahls_law_integrates_the_way() -> None:
    corners = np.array([0.0, 0.4, 0.37, 0.9, 0.86])
    share = 0.0
    for a, b in itertools.pairwise(corners):
        for step in np.diff(np.linspace(a, b, 20_001)):
            share += (step - abs(step) * share) / _WAY_RAD
    bent = Turns((corners,), np.array([1e-3])).bent(0, _WAY_RAD)
    assert bent == pytest.approx(share, abs=1e-3)


@pytest.mark.parametrize(
    ("corners", "least_rad"),
    [([0.0, 0.4], 0.03), ([0.0, 0.04], 1e-3), ([], 1e-3)],
    ids=["its way is within the noise", "hardly seen yet", "never seen"],
)
def test_what_the_motion_does_not_say_is_not_said(corners: list[float], least_rad: float) -> None:
    assert Turns((np.array(corners),), np.array([least_rad])).bent(0, _WAY_RAD) is None
