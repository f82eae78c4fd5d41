"""Wear is noticed on its joint, and a hand that only moves differently is left alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.daemon.cusum import Cusum, run_length, threshold_for
from twin_daemon.daemon.drift import BLOCK_S, SLACK, Alarm, Drift

JOINTS = ("a", "b", "c")
RATE_HZ = 10.0
HOUR_S = 3600.0


class Motion:
    """Residuals of three joints: coloured noise whose size depends on the pace, which changes every half minute."""

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._value = np.zeros(3)
        self._time_s = 0.0
        self._touched = np.zeros(3, dtype=bool)

    def touch(self, joint: int) -> Motion:
        self._touched[joint] = True
        return self

    def run(self, drift: Drift, seconds: float, factor: np.ndarray | float = 1.0, growth: float = 0.0) -> list[Alarm]:
        raised: list[Alarm] = []
        for step in range(round(seconds * RATE_HZ)):
            self._time_s += 1.0 / RATE_HZ
            pace = (0.0, 0.1, 0.4, 1.2)[int(self._time_s // 30.0) % 4]
            size = 0.003 * (1.0 + 2.0 * pace) * np.exp(0.15 * np.sin(2 * np.pi * self._time_s / 700.0))
            self._value = 0.9 * self._value + np.sqrt(1 - 0.81) * self._random.normal(size=3)
            grown = np.ones(3) + np.array([0.0, growth * step / RATE_HZ, 0.0])
            residual = size * self._value * factor * grown
            raised += drift.add(round(self._time_s * 1e9), residual, np.full(3, pace), self._touched)
        return raised


def test_wear_of_one_joint_alarms_there_and_says_since_when() -> None:
    drift, motion = Drift(JOINTS), Motion(1)
    assert not motion.run(drift, HOUR_S)
    assert drift.as_json()["verdict"] == "steady"
    raised = motion.run(drift, 600.0, growth=1.0 / 150.0)  # up to five times in ten minutes
    assert [alarm.joint for alarm in raised] == ["b"]
    assert HOUR_S - 120.0 < raised[0].since_ns * 1e-9 < HOUR_S + 400.0
    answer = drift.as_json()
    assert (answer["verdict"], answer["drifting_joints"]) == ("drifting", ["b"])
    assert answer["joints"]["b"]["ratio"] > 1.3
    drift.clear()
    assert drift.as_json()["verdict"] == "learning"


@pytest.mark.parametrize(
    ("seed", "hours"), [(0, 2), *(pytest.param(seed, 6, marks=pytest.mark.slow) for seed in (0, 1, 2))]
)
def test_hours_without_wear_are_quiet(seed: int, hours: int) -> None:
    drift = Drift(JOINTS)
    assert not Motion(seed).run(drift, hours * HOUR_S)


def test_a_dead_sensor_alarms_within_a_minute() -> None:
    drift, motion = Drift(JOINTS), Motion(4)
    motion.run(drift, HOUR_S)
    raised = motion.run(drift, 60.0, factor=np.array([1.0, 1.0, 40.0]))
    assert [alarm.joint for alarm in raised] == ["c"]


def test_a_joint_that_is_not_measured_says_nothing() -> None:
    drift = Drift(JOINTS)
    for second in range(2000):
        drift.add(second * 10**9, np.full(3, np.nan), np.zeros(3), np.zeros(3, bool))
    assert drift.as_json()["verdict"] == "learning"
    assert drift.as_json()["joints"]["a"]["baseline_rmse_rad"] is None


def test_what_happens_in_contact_is_not_wear() -> None:
    drift, motion = Drift(JOINTS), Motion(5)
    motion.run(drift, HOUR_S)
    assert not motion.touch(2).run(drift, 600.0, factor=np.array([1.0, 1.0, 40.0]))
    told = drift.as_json()["joints"]
    assert (told["a"]["touched_s"], told["c"]["touched_s"]) == (0.0, pytest.approx(600.0))


@given(st.floats(0.3, 1.5), st.floats(2.0, 12.0))
def test_the_threshold_is_the_inverse_of_the_run_length(slack: float, log_blocks: float) -> None:
    blocks = 10.0**log_blocks
    assert run_length(threshold_for(blocks, slack), slack) == pytest.approx(blocks, rel=1e-6)


def test_false_alarms_come_about_as_often_as_asked() -> None:
    # a mean of 500 blocks between alarms, where simulating them is cheap
    slack, series = 0.5, 400
    test = Cusum(series, slack, threshold_for(500.0, slack))
    random = np.random.default_rng(0)
    alarms = 0
    for block in range(2000):
        above = test.add(np.full(series, block), random.normal(size=series))
        alarms += int(above.sum())
        test.sums[above] = 0.0
    assert 2000 * series / alarms == pytest.approx(500.0, rel=0.25)


def test_blocks_are_what_the_threshold_counts() -> None:
    drift = Drift(JOINTS, false_alarms_per_day=1.0)
    expected = 86_400.0 / BLOCK_S * len(JOINTS)
    assert run_length(drift.as_json()["threshold"], SLACK) == pytest.approx(expected, rel=1e-6)
