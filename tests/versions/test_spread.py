"""How much a hand differs from session to session is learnt from its own versions."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from twin_daemon.versions.history import Point
from twin_daemon.versions.spread import learnt_spread
from twin_daemon.versions.trend import USUAL_SPREAD

START = datetime(2026, 1, 1, tzinfo=UTC)


def hand(spread: float, *, weeks: int, values: int = 12, growth: float = 0.0, seed: int = 0) -> list[list[Point]]:
    """Values that differ by `spread` from week to week, known to 1 %, all growing by a share of them a week."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(values):
        drawn = np.exp(growth * np.arange(weeks) + spread * rng.standard_normal(weeks))
        drawn *= 0.3 * np.exp(0.01 * rng.standard_normal(weeks))
        days = [START + timedelta(7 * week) for week in range(weeks)]
        found.append([Point(at, "", v, (v * 0.98, v * 1.02)) for at, v in zip(days, drawn.tolist(), strict=True)])
    return found


@pytest.mark.parametrize("spread", [0.015, 0.03, 0.1])
@pytest.mark.parametrize("growth", [0.0, 0.05])
def test_steady_wear_is_no_part_of_it(spread: float, growth: float) -> None:
    assert learnt_spread(hand(spread, weeks=10, growth=growth)) == pytest.approx(spread, rel=0.25)


def test_a_repair_counts_for_little() -> None:
    repaired = hand(0.02, weeks=12)
    for points in repaired[:3]:
        points[6:] = [Point(p.at, "", 0.5 * p.value, (0.49 * p.value, 0.51 * p.value)) for p in points[6:]]
    assert learnt_spread(repaired) == pytest.approx(0.02, rel=0.4)


def test_until_there_are_three_nothing_is_learnt() -> None:
    assert learnt_spread(hand(0.1, weeks=2)) is None


def test_one_value_of_three_versions_hardly_moves_what_is_usual() -> None:
    learnt = learnt_spread(hand(0.03, weeks=3, values=1))
    assert learnt is not None
    assert USUAL_SPREAD / 2.0 < learnt < USUAL_SPREAD * 2.0


def test_it_is_never_narrower_than_fits_that_start_from_each_other_may_say() -> None:
    assert learnt_spread(hand(0.0, weeks=20)) == pytest.approx(USUAL_SPREAD / 3.0)
