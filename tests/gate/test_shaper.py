"""The setpoint's way: properties that hold for any target, any limits and turns of any length."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.gate.limits import Limits
from twin_daemon.gate.shaper import Shaper

SPEEDS = st.floats(0.1, 20.0)
SUDDEN = st.floats(1.0, 2000.0)
TURNS = st.lists(st.tuples(st.floats(-3.0, 3.0), st.floats(1e-6, 0.02)), min_size=1, max_size=60)


def limits(velocity: float, acceleration: float) -> Limits:
    one = np.ones(1)
    return Limits(("a",), -1.0 * one, 1.0 * one, velocity * one, acceleration * one, 0.0 * one, ("rad",), one < 0.0)


@given(SPEEDS, SUDDEN, TURNS, st.floats(-1.0, 1.0))
def test_it_never_leaves_its_limits(
    velocity: float, acceleration: float, turns: list[tuple[float, float]], start: float
) -> None:
    shaper = Shaper(limits(velocity, acceleration))
    shaper.begin(np.array([start]))
    before, speed = start, 0.0
    for target, dt_s in turns:
        goal = np.array([target if abs(target) <= 1.0 else np.nan])
        shaper.take(*shaper.toward(goal, dt_s))
        now = float(shaper.position[0])
        made = (now - before) / dt_s
        slack = 1e-9 / dt_s
        assert -1.0 <= now <= 1.0
        assert abs(made) <= velocity + slack
        assert abs(made - speed) <= acceleration * dt_s * (1 + 1e-9) + 2 * slack
        before, speed = now, made


@given(SPEEDS, SUDDEN, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_it_arrives_exactly_and_rests(velocity: float, acceleration: float, start: float, target: float) -> None:
    shaper = Shaper(limits(velocity, acceleration))
    shaper.begin(np.array([start]))
    path = []
    for _ in range(100_000):
        shaper.take(*shaper.toward(np.array([target]), 0.008))
        path.append(float(shaper.position[0]))
        if shaper.still and path[-1] == target:
            break
    assert path[-1] == target
    assert shaper.still
    low, high = sorted((start, target))
    assert min(path) >= low - 1e-9
    assert max(path) <= high + 1e-9


def test_a_command_that_was_never_given_stays_unknown() -> None:
    shaper = Shaper(limits(1.0, 10.0))
    shaper.take(*shaper.toward(np.array([0.5]), 0.01))
    assert np.isnan(shaper.position[0])
    assert shaper.still
