"""What the hand was told, in each of the three forms in which bags hold it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin_daemon.recordings import load_recording
from twin_daemon.recordings.controller_topics import joint_of_topic

from .bag_files import Float64, JointState, Message, Trajectory, write_bag

SECOND = 10**9
START = 1_700_000_000 * SECOND
NAMES = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3")


def measured() -> list[Message]:
    return [JointState(START + i * SECOND // 10, NAMES, (0.0, 0.1, 0.2)) for i in range(101)]


def at(recording, name: str, time_s: float) -> float:
    commands = recording.commands
    column = commands.position[:, commands.names.index(name)]
    return float(np.interp(time_s, (commands.stamp_ns - START) * 1e-9, column))


def test_streamed_targets_hold(tmp_path: Path) -> None:
    streamed = [
        JointState(START + SECOND, ("rh_FFJ0",), (0.5,), topic="/joint_commands"),
        JointState(START + 2 * SECOND, ("rh_FFJ3", "rh_FFJ0"), (0.7, 0.6), topic="/joint_commands"),
    ]
    commands = load_recording(write_bag("mcap", tmp_path, [*measured(), *streamed])).commands
    assert commands is not None
    assert commands.interpolation == "hold"
    assert commands.names == ("rh_FFJ0", "rh_FFJ3")
    np.testing.assert_array_equal(commands.position, [[0.5, np.nan], [0.6, 0.7]])
    np.testing.assert_array_equal(commands.stamp_ns, [START + SECOND, START + 2 * SECOND])


@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_controllers_are_named_after_their_joints(form: str, tmp_path: Path) -> None:
    sent: list[Message] = [
        Float64(0.4, START + SECOND, "/sh_rh_ffj3_position_controller/command"),
        Float64(0.8, START + 2 * SECOND, "/sh_rh_ffj0_position_controller/command"),
        Float64(float("nan"), START + 3 * SECOND, "/sh_rh_ffj0_position_controller/command"),
        Float64(99.0, START + 3 * SECOND, "/temperature"),
    ]
    recording = load_recording(write_bag(form, tmp_path, [*measured(), *sent]))
    commands = recording.commands
    assert commands is not None
    assert set(commands.names) == {"rh_FFJ3", "rh_FFJ0"}
    assert commands.interpolation == "hold"
    np.testing.assert_array_equal(commands.stamp_ns, [START + SECOND, START + 2 * SECOND])
    assert np.nanmax(commands.position) == 0.8
    assert recording.quality.commands_dropped == {"nan": 1, "all_nan": 1}


@pytest.mark.parametrize(
    ("topic", "name"),
    [
        ("/sh_rh_thj5_position_controller/command", "rh_THJ5"),
        ("/hand/sh_lh_wrj2_mixed_position_velocity_controller/command", "lh_WRJ2"),
        ("/elbow_position_controller/command", "Elbow"),
        ("/sh_rh_ffj3_position_controller/state", None),
        ("/command", None),
    ],
)
def test_topics_of_controllers(topic: str, name: str | None) -> None:
    assert joint_of_topic(topic, ("Elbow",)) == name


@pytest.mark.parametrize("form", ["bag", "mcap"])
def test_a_trajectory_sets_out_from_where_the_joint_is(form: str, tmp_path: Path) -> None:
    sent = Trajectory(START + SECOND, ("rh_FFJ3",), [(1.0, [1.2]), (2.0, [0.2])], received_ns=START + SECOND + 99)
    recording = load_recording(write_bag(form, tmp_path, [*measured(), sent]))
    assert recording.commands is not None
    assert recording.commands.interpolation == "linear"
    assert at(recording, "rh_FFJ3", 0.0) == pytest.approx(0.2)
    assert at(recording, "rh_FFJ3", 1.5) == pytest.approx(0.7)
    assert at(recording, "rh_FFJ3", 2.5) == pytest.approx(0.7)
    assert at(recording, "rh_FFJ3", 9.0) == pytest.approx(0.2)


def test_a_later_trajectory_replaces_what_remains_of_its_joints(tmp_path: Path) -> None:
    both = Trajectory(START, ("rh_FFJ2", "rh_FFJ3"), [(0.0, [0.1, 0.0]), (4.0, [0.5, 4.0])], received_ns=START)
    one = Trajectory(START + 2 * SECOND, ("rh_FFJ3",), [(1.0, [0.0])], received_ns=START + 2 * SECOND)
    recording = load_recording(write_bag("mcap", tmp_path, [*measured(), both, one]))
    assert at(recording, "rh_FFJ3", 1.0) == pytest.approx(1.0)
    assert at(recording, "rh_FFJ3", 2.5) == pytest.approx(1.0)
    assert at(recording, "rh_FFJ3", 4.0) == pytest.approx(0.0)
    assert at(recording, "rh_FFJ2", 3.0) == pytest.approx(0.4)


def test_a_pause_between_trajectories_is_held_and_a_first_point_at_once_is_a_step(tmp_path: Path) -> None:
    first = Trajectory(START, ("rh_FFJ3",), [(1.0, [1.0])], received_ns=START)
    step = Trajectory(START + 5 * SECOND, ("rh_FFJ3",), [(0.0, [0.3])], received_ns=START + 5 * SECOND)
    recording = load_recording(write_bag("mcap", tmp_path, [*measured(), first, step]))
    assert at(recording, "rh_FFJ3", 4.999) == pytest.approx(1.0)
    assert at(recording, "rh_FFJ3", 5.0) == pytest.approx(0.3)


def test_an_empty_trajectory_stops_and_an_unset_stamp_means_now(tmp_path: Path) -> None:
    sent = [
        Trajectory(0, ("rh_FFJ3",), [(4.0, [4.2])], received_ns=START),
        Trajectory(0, ("rh_FFJ3",), [], received_ns=START + SECOND),
    ]
    recording = load_recording(write_bag("mcap", tmp_path, [*measured(), *sent]))
    assert at(recording, "rh_FFJ3", 9.0) == pytest.approx(1.2)
    assert any("trajectories" in note for note in recording.quality.notes)


def test_trajectories_that_contradict_themselves_are_counted(tmp_path: Path) -> None:
    good = Trajectory(START, ("rh_FFJ3",), [(1.0, [1.0])], received_ns=START)
    bad = [
        Trajectory(START, ("rh_FFJ3",), [(1.0, [1.0, 2.0])], received_ns=START + 1),
        Trajectory(START, ("rh_FFJ3",), [(1.0, [1.0]), (0.5, [2.0])], received_ns=START + 2),
        Trajectory(START, ("rh_FFJ3", "rh_FFJ3"), [(1.0, [1.0, 2.0])], received_ns=START + 3),
    ]
    recording = load_recording(write_bag("mcap", tmp_path, [*measured(), good, *bad]))
    assert recording.quality.commands_dropped == {"wrong_length": 1, "backward": 1, "repeated_names": 1}


def test_streamed_commands_come_before_trajectories(tmp_path: Path) -> None:
    sent: list[Message] = [
        Trajectory(START, ("rh_FFJ3",), [(1.0, [1.0])], received_ns=START),
        JointState(START, ("rh_FFJ3",), (0.5,), topic="/rh/joint_commands"),
    ]
    recording = load_recording(write_bag("mcap", tmp_path, [*measured(), *sent]))
    assert recording.quality.command_topics == ("/rh/joint_commands",)
    assert recording.commands is not None
    assert recording.commands.interpolation == "hold"
