"""Starts that are read off the motion: near what is there on slow slides and on fast fingers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Scale, Seen

SCALE = Scale(
    kp=1.0, force_nm=1.0, damping=0.05, frictionloss=0.01, inertia=1e-3, armature=1e-4, lower=-1.0, upper=1.0,
    step_s=0.002,
)  # fmt: skip
DT = 0.01


def _steps(size: float) -> np.ndarray:
    """(n,) commands that step every two seconds."""
    return np.repeat(np.random.default_rng(0).uniform(-size, size, 12), round(2.0 / DT))


def _slewed(command: np.ndarray, rate: float) -> np.ndarray:
    out = [float(command[0])]
    for wanted in command[1:].tolist():
        out.append(out[-1] + float(np.clip(wanted - out[-1], -rate * DT, rate * DT)))
    return np.array(out)


@given(st.floats(-3.0, 1.5), st.floats(0.05, 0.9))
def test_a_limit_of_rate_begins_near_the_speed_that_the_joint_reached(decades: float, share: float) -> None:
    size = 10.0**decades
    rate = share * 2.0 * size  # within two seconds of a step it gets somewhere
    command = _steps(size)
    angle = _slewed(command, rate)
    starts = LIBRARY["rate_limit"].suggested(SCALE, Seen(angle, np.gradient(angle, DT), angle - command))
    assert min(abs(np.log(one["rate"] / rate)) for one in starts) < np.log(1.2)


@pytest.mark.parametrize(("effect", "value"), [("command_delay", "delay"), ("actuator_lag", "tau")])
@given(late_s=st.floats(1e-4, 0.2))
def test_what_is_late_begins_near_the_time_by_which_it_is(effect: str, value: str, late_s: float) -> None:
    time_s = np.arange(0.0, 20.0, DT)
    angle, before = (np.sin(0.7 * (time_s - shift)) for shift in (late_s, 0.0))
    starts = LIBRARY[effect].suggested(SCALE, Seen(angle, np.gradient(angle, DT), angle - before))
    assert min(abs(one[value] / late_s - 1.0) for one in starts) < 0.1


def test_motion_that_is_early_suggests_no_delay() -> None:
    time_s = np.arange(0.0, 20.0, DT)
    angle = np.sin(time_s)
    seen = Seen(angle, np.gradient(angle, DT), angle - np.sin(time_s - 0.05))
    assert LIBRARY["command_delay"].suggested(SCALE, seen) == ()
    assert LIBRARY["viscous_friction"].suggested(SCALE, seen) == LIBRARY["viscous_friction"].starts(SCALE)


@given(st.floats(-3.0, 1.5))
def test_friction_that_fades_begins_within_the_speeds_of_the_motion(decades: float) -> None:
    time_s = np.arange(0.0, 20.0, DT)
    speed = 10.0**decades * np.cos(time_s)
    starts = LIBRARY["stribeck_friction"].suggested(SCALE, Seen(10.0**decades * np.sin(time_s), speed, 0.0 * speed))
    assert all(0.01 * speed.max() < one["velocity"] < speed.max() for one in starts)


@pytest.mark.parametrize(
    ("effect", "value"),
    [("stribeck_friction", "breakaway"), ("coulomb_friction", "friction"), ("hysteresis", "torque")],
)
@given(decades=st.floats(-4.0, 1.0))
def test_dry_friction_begins_near_what_keeps_the_joint_from_its_target(effect: str, value: str, decades: float) -> None:
    held = 10.0**decades  # rad: a servo of 1 N m/rad pulls with as many N m and does not get any further
    rng = np.random.default_rng(0)
    command = np.repeat(rng.uniform(-5.0 * held, 5.0 * held, 30), 100)
    target = np.repeat(rng.uniform(-held, held, 30), 100)
    angle = command + target
    speed = np.where(np.arange(len(angle)) % 100 < 20, held, 0.0)
    starts = LIBRARY[effect].suggested(SCALE, Seen(angle, speed, target))
    assert min(abs(np.log(max(one[value], 1e-9) / held)) for one in starts) < np.log(2.0)


def test_a_joint_that_stands_still_suggests_no_speed() -> None:
    still = np.zeros(100)
    for effect in ("rate_limit", "stribeck_friction"):
        assert LIBRARY[effect].suggested(SCALE, Seen(still, still, still)) == ()


@given(st.floats(0.1, 6.0), st.floats(0.1, 0.9))
def test_a_stop_anywhere_in_the_range_of_an_arm_that_turns_twice_is_looked_for(half_span: float, share: float) -> None:
    scale = replace(SCALE, lower=-half_span, upper=half_span)
    bounds = LIBRARY["joint_stop"].bounds(scale)
    for end in ("upper", "lower"):
        lowest, highest = bounds[end]
        assert lowest <= share * 2.0 * half_span <= highest


@pytest.mark.parametrize("periods", [9.0, 34.0])
def test_a_ripples_waves_are_read_off_a_servo_that_is_too_slow_to_show_them(periods: float) -> None:
    """A large arm's joint takes a quarter of a second to follow, and passes a wave in a tenth of that."""
    slow = replace(SCALE, kp=130.0, damping=32.0, inertia=3.0)
    time_s = np.arange(0.0, 20.0, DT)
    angle = 0.8 * np.sin(0.7 * time_s) + 0.3 * np.sin(1.9 * time_s)
    torque = 2.0 * np.sin(periods * angle + 1.0)
    gap, speed = np.zeros((2, len(time_s)))
    for row in range(1, len(time_s)):
        speed[row] = speed[row - 1] + DT / slow.inertia * (
            torque[row - 1] - slow.damping * speed[row - 1] - slow.kp * gap[row - 1]
        )
        gap[row] = gap[row - 1] + DT * speed[row]
    seen = Seen(angle, np.gradient(angle, DT), gap, time_s)
    best = LIBRARY["torque_ripple"].suggested(slow, seen)[0]
    assert best["periods"] == pytest.approx(periods, abs=0.1)
    assert 1.0 < best["amplitude"] < 3.0
    assert np.cos(best["phase"] - 1.0) > 0.95


@pytest.mark.parametrize("key", sorted(LIBRARY))
@given(decades=st.floats(-3.0, 3.0))
def test_a_robot_of_any_strength_has_room_about_its_starts(key: str, decades: float) -> None:
    """A finger of 9 g has a servo of 0.006 N m/rad: what bends at it is a hundred times softer than at a hand."""
    strong = {name: 10.0**decades * getattr(SCALE, name) for name in ("kp", "force_nm", "damping", "frictionloss")}
    heavy = {name: 10.0**decades * getattr(SCALE, name) for name in ("inertia", "armature")}
    scale = replace(SCALE, **strong, **heavy)
    effect = LIBRARY[key]
    bounds = effect.bounds(scale)
    for start in effect.starts(scale):
        for name, value in effect.complete(start).items():
            assert bounds[name][0] <= value <= bounds[name][1], name


@pytest.mark.parametrize("key", ["joint_stop", "nonlinear_spring", "torque_ripple"])
def test_a_weaker_effect_is_where_the_stronger_one_was(key: str) -> None:
    effect = LIBRARY[key]
    hypothesis = Hypothesis(effect, "joint", (), effect.bounds(SCALE))
    for start in effect.starts(SCALE):
        weaker = hypothesis.along(start, 0.5)
        strength = effect.parameters[0].name
        assert weaker == start | {strength: 0.5 * start[strength]}
