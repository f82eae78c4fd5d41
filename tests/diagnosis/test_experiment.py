"""The next experiment: inside the hand's limits, and where the candidates differ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.findings import finding
from twin_daemon.diagnosis.experiment_design import FAMILY, expected_difference, motion, next_experiment
from twin_daemon.diagnosis.verdict import Diagnosis
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.hand import Hand
from twin_daemon.recordings import load_recording
from twin_daemon.signals.trajectory import allowed_range, load_trajectory
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

COMMANDS = ["rh_FFJ0", "rh_FFJ3", "rh_THJ1"]


@pytest.mark.parametrize("name", FAMILY)
def test_every_motion_keeps_within_the_limits(name: str, hand: Hand) -> None:
    made = motion(hand, COMMANDS, FAMILY[name](), name)
    speed = np.abs(np.diff(made.positions, axis=0)) / np.diff(made.times_s)[:, None]
    for column, command in enumerate(COMMANDS):
        low, high = allowed_range(command, hand)
        assert low < made.positions[:, column].min() < made.positions[:, column].max() < high
        assert speed[:, column].max() <= hand.velocity_limit_rad_s(command)
    one_at_a_time = (np.diff(made.positions, axis=0) != 0).sum(axis=1)
    assert one_at_a_time.max() == 1


def _terms(effect: str, **values: float) -> Terms:
    return Terms(effects=(EffectTerm(effect=effect, target="rh_FFJ3", values=values),))


def _play_or_offset(target: str, joints: tuple[str, ...]) -> Diagnosis:
    gap = Estimate(value=0.05, unit="rad", ci95=(0.04, 0.06))
    found = finding("backlash", target, joints, "sensor_offset:rh_FFJ3", gap=gap)
    return Diagnosis(verdict="ambiguous", reason="two", findings=(found,), tried=(), where=(), parts={})


def test_candidates_that_are_the_same_cannot_be_separated(twin: TwinModel, hand: Hand) -> None:
    made = motion(hand, ["rh_FFJ3"], FAMILY["small reversals"](), "reversals")
    play = _terms("backlash", gap=0.03)
    assert expected_difference(twin, {"a": play, "b": play}, made, ["rh_FFJ3"]) == 0.0
    offset = _terms("sensor_offset", offset=0.02)
    apart = expected_difference(twin, {"a": Terms(), "b": offset}, made, ["rh_FFJ3"])
    assert apart == pytest.approx(0.02, rel=1e-6)


@pytest.mark.slow
def test_an_ambiguous_verdict_gets_the_motion_that_separates_best(
    sound: Path, twin: TwinModel, hand: Hand, tmp_path: Path
) -> None:
    found = _play_or_offset("rh_FFJ3", ("rh_FFJ3",))
    aligned = align(twin, load_recording(sound))
    proposed = next_experiment(twin, [aligned], found, tmp_path)
    assert proposed is not None
    assert proposed.separates == ("backlash:rh_FFJ3", "sensor_offset:rh_FFJ3")
    assert proposed.expected_difference_rad == max(proposed.considered.values()) > 1e-3
    assert proposed.motion in proposed.why
    assert Path(proposed.path).parent == tmp_path
    assert load_trajectory(proposed.trajectory, hand).joints == ("rh_FFJ3",)


def test_other_verdicts_need_no_experiment(twin: TwinModel, tmp_path: Path) -> None:
    assert next_experiment(twin, [], Diagnosis.without_findings("within_noise", ""), tmp_path) is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_finding_at_a_pairs_command_is_separated_by_its_joints(sound: Path, twin: TwinModel, tmp_path: Path) -> None:
    found = _play_or_offset("rh_FFJ0", ("rh_FFJ0", "rh_FFJ2", "rh_FFJ1"))
    proposed = next_experiment(twin, [align(twin, load_recording(sound))], found, tmp_path)
    assert proposed is not None
    assert (proposed.expected_difference_rad or 0.0) > 1e-3
