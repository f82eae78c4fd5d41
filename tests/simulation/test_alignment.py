"""Commands and measurements on one clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.errors import BadInput
from twin_daemon.recordings.recording import Recording
from twin_daemon.signals.trajectory import Trajectory
from twin_daemon.simulation.alignment import align, command_onset, model_onset, predict
from twin_daemon.simulation.twin import TwinModel


def trajectory() -> Trajectory:
    times = np.unique(np.concatenate([np.array(t) for t, _ in FINGER.values()]))
    positions = np.column_stack([np.interp(times, t, p) for t, p in FINGER.values()])
    return Trajectory("finger", tuple(FINGER), times, positions)


def test_recorded_commands_need_no_onset(twin: TwinModel, rng: np.random.Generator) -> None:
    aligned = align(twin, recorded(twin, FINGER, rng, late_s=0.37))
    assert not aligned.onset_free
    assert aligned.onset_s == 0.0
    assert np.sqrt(np.mean((predict(twin, aligned) - aligned.measured) ** 2)) < 1e-3


@pytest.mark.parametrize("late_s", [0.0, 0.37, -0.2])
def test_the_onset_of_a_trajectory_is_recovered(late_s: float, twin: TwinModel, rng: np.random.Generator) -> None:
    aligned = align(twin, recorded(twin, FINGER, rng, late_s=late_s, commands=False, seconds=6.0), trajectory())
    assert aligned.onset_free
    # the raw command contains the servo's lag, the model brings its own
    assert command_onset(twin, aligned) == pytest.approx(late_s, abs=0.15)
    # a streamed target is held for a sample, so it comes half of 8 ms later than the line through it
    assert model_onset(twin, aligned) == pytest.approx(late_s + 0.004, abs=0.003)


def test_a_recorded_command_that_repeats_is_not_moved_by_a_whole_period(
    twin: TwinModel, rng: np.random.Generator
) -> None:
    times = np.arange(0.0, 12.0, 0.02)
    motion = {"rh_FFJ3": (list(times), list(0.5 + 0.3 * np.sin(2 * np.pi * times / 1.5)))}
    aligned = align(twin, recorded(twin, motion, rng, seconds=12.0))
    assert 0.0 < command_onset(twin, aligned) < 0.2


def test_the_joints_that_move_are_known(twin: TwinModel, rng: np.random.Generator) -> None:
    aligned = align(twin, recorded(twin, FINGER, rng))
    assert {n for n, moves in zip(aligned.joints, aligned.moving, strict=True) if moves} == {
        "rh_FFJ1", "rh_FFJ2", "rh_FFJ3",
    }  # fmt: skip


@pytest.mark.parametrize("every", [1, 3])
def test_a_recording_that_starts_in_motion_starts_in_motion(
    every: int, twin: TwinModel, rng: np.random.Generator
) -> None:
    recording = recorded(twin, FINGER, rng).window(0.7)
    fewer = renamed(recording, stamp_ns=recording.stamp_ns[::every], position=recording.position[::every])
    aligned = align(twin, fewer)
    sums = aligned.start_velocity[[twin.joints.index(f"rh_FFJ{n}") for n in (1, 2)]].sum()
    assert sums == pytest.approx(1.6 / 0.5, rel=0.3)


@pytest.mark.parametrize("rate_hz", [40.0, 1000.0])
def test_how_fast_a_joint_is_at_the_start_is_within_what_is_said_of_it(
    rate_hz: float, twin: TwinModel, rng: np.random.Generator
) -> None:
    made = recorded(twin, FINGER, rng, seconds=2.0)
    time_s = np.arange(0.0, 1.0, 1.0 / rate_hz)
    column = twin.joints.index("rh_FFJ3")
    moves = {"still": (0.0 * time_s, 0.0), "on its way": (0.5 * time_s, 0.5), "sets off": (3.0 * time_s**2, 0.0)}
    for angle, velocity in moves.values():
        position = np.zeros((len(time_s), len(twin.joints)))
        position[:, column] = angle + 3e-4 * rng.standard_normal(len(time_s))
        stamps = made.stamp_ns[0] + np.round(1e9 * time_s).astype(np.int64)
        aligned = align(twin, renamed(made, stamp_ns=stamps, position=position, joints=twin.joints))
        assert aligned.start_sigma is not None
        assert abs(aligned.start_velocity[column] - velocity) < 4.0 * aligned.start_sigma[1, column]


def test_a_joint_that_is_absent_is_not_measured(twin: TwinModel, rng: np.random.Generator) -> None:
    aligned = align(twin, recorded(twin, FINGER, rng).select(["rh_FFJ3"]))
    assert np.isnan(aligned.measured[:, twin.joints.index("rh_FFJ2")]).all()
    assert np.isfinite(predict(twin, aligned)).all()


def renamed(recording: Recording, **changes: object) -> Recording:
    return replace(recording, **changes)  # type: ignore[arg-type]


def test_recordings_of_something_else_are_refused(twin: TwinModel, rng: np.random.Generator) -> None:
    recording = recorded(twin, FINGER, rng, seconds=1.0)
    with pytest.raises(BadInput, match=r"none of its joints.*--joint-map"):
        align(twin, renamed(recording, joints=tuple(f"arm_{i}" for i in range(len(recording.joints)))))
    with pytest.raises(BadInput, match=r"holds no commands.*--trajectory"):
        align(twin, renamed(recording, commands=None))
    assert recording.commands is not None
    foreign = replace(recording.commands, names=("arm_1", "arm_2"))
    with pytest.raises(BadInput, match="none of its commands"):
        align(twin, renamed(recording, commands=foreign))


def test_a_command_that_has_not_come_yet_holds_back_no_other(twin: TwinModel) -> None:
    rest = np.full(len(twin.actuators), 0.1)
    controls = twin.controls(("rh_FFJ3", "rh_MFJ3", "rh_LFJ1", "rh_LFJ2"), np.array([[0.7, np.nan, 0.2, 0.3]]), rest)[0]
    said = dict(zip(twin.actuators, controls, strict=True))
    assert said.pop("rh_FFJ3") == 0.7
    assert said.pop("rh_LFJ0") == 0.5  # the sum of its joints, where only they are commanded
    assert set(said.values()) == {0.1}
