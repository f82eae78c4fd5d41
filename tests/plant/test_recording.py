"""Runs of the plant as bags: what is on the bus is in them, the answer is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.hand import Hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich, slow_closing
from twin_daemon.plant.recording import record, simulate
from twin_daemon.recordings import load_recording

from .conftest import FF3


def test_a_recorded_run_reads_back_as_it_was(hand: Hand, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    plant = Plant(hand, hidden=[parse_hidden("backlash:FFJ3=0.05", hand)], seed=3)
    run = record(plant, rich(hand, ["FFJ3", "FFJ0"], 2.0), path, jitter_s=0.001, command_rate_hz=100.0)
    read = load_recording(path)
    assert set(read.joints) == set(hand.joints)
    order = [read.joints.index(name) for name in run.joints]
    assert np.array_equal(read.position[:, order], run.position)
    assert read.commands is not None
    assert set(read.commands.names) == set(hand.commands)
    assert read.commands.interpolation == "hold"
    column = read.commands.names.index(FF3)
    assert np.array_equal(read.commands.position[:, column], run.command[:, run.commands.index(FF3)])
    assert np.allclose(read.time_s, run.time_s - run.time_s[0], atol=1e-8)
    assert read.commands.stamp_ns[0] < read.stamp_ns[0]  # the targets in force are known from the start
    assert b"backlash" not in path.read_bytes()


def test_the_same_run_gives_the_same_bytes(hand: Hand, tmp_path: Path) -> None:
    one, two = tmp_path / "one" / "run.mcap", tmp_path / "two" / "run.mcap"
    for path in (one, two):
        path.parent.mkdir()
        record(Plant(hand, seed=1), slow_closing(hand, seconds=0.5), path)
    assert one.read_bytes() == two.read_bytes()


def test_a_run_begins_at_rest_at_its_first_targets(hand: Hand) -> None:
    run = simulate(Plant(hand, ideal_sensors=True), lambda t: {FF3: 0.8}, duration_s=0.5)
    assert run.column(FF3)[0] == pytest.approx(0.8, abs=0.01)
    assert np.ptp(run.column(FF3)) < 1e-3


def test_stamps_jitter_within_their_bound_and_never_overtake(hand: Hand) -> None:
    plant = Plant(hand)
    run = simulate(plant, lambda t: {}, duration_s=1.0, jitter_s=0.003, rate_hz=100.0)
    off = run.time_s - np.arange(101) / 100
    assert 0.002 < np.abs(off).max() <= 0.003
    assert np.all(np.diff(run.time_s) > 0)
    with pytest.raises(BadInput, match="overtake"):
        simulate(plant, lambda t: {}, duration_s=1.0, jitter_s=0.006, rate_hz=100.0)
    with pytest.raises(BadInput, match="duration_s"):
        simulate(plant, lambda t: {})


@pytest.mark.parametrize("seed", [0, 1])
def test_a_rich_motion_has_steps_two_speeds_reversals_and_holds_inside_the_range(hand: Hand, seed: int) -> None:
    motion = rich(hand, ["rh_FFJ3", "rh_FFJ0", "rh_THJ4"], seconds=20.0, seed=seed)
    assert motion.times_s[-1] == pytest.approx(20.0)
    ticks = motion.sample(np.arange(0, 20, 0.008))
    for name, angle in zip(motion.joints, ticks.T, strict=True):
        low, high = hand.command_range_rad[name]
        speed = np.abs(np.diff(angle)) / 0.008 / (high - low)
        assert low < angle.min() < angle.max() < high
        assert np.mean(speed == 0.0) > 0.15  # holds
        assert np.mean((speed > 0.05) & (speed < 0.3)) > 0.1  # slow
        assert np.mean((speed > 0.3) & (speed < 3.0)) > 0.05  # fast
        assert np.sum(speed > 5.0) >= 3  # steps
        turns = np.diff(np.sign(np.diff(angle[np.flatnonzero(np.diff(angle))])))
        assert np.sum(turns != 0) >= 10
    assert np.array_equal(motion.positions, rich(hand, ["rh_FFJ3", "rh_FFJ0", "rh_THJ4"], 20.0, seed).positions)
    assert not np.array_equal(ticks[:, 0], rich(hand, ["FFJ3"], 20.0, seed + 7).sample(np.arange(0, 20, 0.008))[:, 0])
    with pytest.raises(BadInput, match="rh_FFJ"):
        rich(hand, ["FFJ33"])


def test_a_slow_closing_closes_the_fingers_and_opens_them_again(hand: Hand) -> None:
    run = simulate(Plant(hand, ideal_sensors=True), slow_closing(hand, seconds=4.0))
    for joint in ("rh_FFJ3", "rh_MFJ2", "rh_LFJ1"):
        angle = run.column(joint)
        assert angle.max() > 1.0
        assert abs(angle[-1] - angle[0]) < 0.2
