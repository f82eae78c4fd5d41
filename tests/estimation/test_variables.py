"""A variable's coordinate and its value are two names of one thing."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.estimation.variables import ParameterVariable


def variable(lower: float, upper: float, log: bool) -> ParameterVariable:
    return ParameterVariable("x.damping", "N m s/rad", lower, upper, lower, log, parameters=("x.damping",))


bounds = st.tuples(st.floats(1e-6, 1e2), st.floats(1.01, 1e4)).map(lambda b: (b[0], b[0] * b[1]))


@given(bounds, st.booleans(), st.floats(0, 1))
def test_there_and_back(box: tuple[float, float], log: bool, coordinate: float) -> None:
    one = variable(*box, log)
    value = one.value(coordinate)
    assert box[0] <= value <= box[1]
    assert one.coordinate(value) == pytest.approx(coordinate, abs=1e-9)


@given(bounds, st.booleans(), st.floats(-10, 1e7))
def test_what_lies_outside_comes_to_the_wall(box: tuple[float, float], log: bool, value: float) -> None:
    one = variable(*box, log)
    assert 0.0 <= one.coordinate(value) <= 1.0
    if not box[0] < value < box[1]:
        assert one.at_bound(value)


def test_the_middle_is_not_on_a_bound() -> None:
    assert not variable(1e-3, 10.0, True).at_bound(0.1)
    assert variable(1e-3, 10.0, True).value(0.5) == pytest.approx(0.1)
