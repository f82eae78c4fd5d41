"""Laws of the library beside the same laws written apart, at the same values."""

from __future__ import annotations

import pytest

from bench.law_errors import LawError, law_error, page
from bench.random_robots.laws import Law
from bench.random_robots.laws.friction import Load
from bench.random_robots.laws.springs import Hysteresis, Stop
from bench.random_robots.laws.transmission import ServoPlay

_SLOW = pytest.mark.slow


@pytest.mark.parametrize("law", [Load, *(pytest.param(law, marks=_SLOW) for law in (Hysteresis, Stop, ServoPlay))])
def test_a_law_of_the_library_is_off_by_hardly_more_than_the_time_step(law: type[Law]) -> None:
    error = law_error(law, 90004)
    assert error.off < 1.2 * error.step < 0.25 * error.does


def test_the_page_has_a_row_for_each_law_and_robot() -> None:
    error = LawError("ServoPlay", "backlash", 90000, 1e-3, 4.0, 0.4, 0.35, 0.6)
    assert page([error]).splitlines()[2] == "| backlash (ServoPlay) | 90000 | 1 ms | 4.00 | 0.40 | 10% | 0.35 | 0.60 |"
