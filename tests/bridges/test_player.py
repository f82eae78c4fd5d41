"""A recording on its way to the network: nothing is added, nothing is lost, time between stamps stays."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bridges.zenoh.player import Timeline
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.recording import Recording
from twin_daemon.recordings.writer import McapWriter

NAMES = ("rh_FFJ1", "rh_FFJ2")
MS = 1_000_000
BEGIN = 1_700_000_000_000 * MS


def recording(path: Path) -> Recording:
    with McapWriter(path) as writer:
        for sample in range(10):
            stamp = BEGIN + sample * 8 * MS
            if sample % 2 == 0:
                writer.joint_commands(stamp, ("rh_FFJ0",), [0.1 * sample])
            names = NAMES if sample != 3 else NAMES[:1]
            writer.joint_states(stamp, names, [0.01 * sample] * len(names))
    return load_recording(path)


def test_states_and_commands_come_in_order_with_the_command_first(tmp_path: Path) -> None:
    loaded = recording(tmp_path / "r.mcap")
    timeline = Timeline.of(loaded, loaded.commands)
    assert timeline.is_command.sum() == 5
    assert len(timeline.stamp_ns) == 15
    assert (np.diff(timeline.stamp_ns) >= 0).all()
    assert timeline.is_command[0]
    first, second = timeline.sample(0, 1000), timeline.sample(1, 1000)
    assert first.stamp_ns == second.stamp_ns == BEGIN + 1000
    assert first.names == ("rh_FFJ0",)
    assert second.names == NAMES


def test_joints_that_a_message_lacked_are_left_out_again(tmp_path: Path) -> None:
    loaded = recording(tmp_path / "r.mcap")
    timeline = Timeline.of(loaded, None)
    assert timeline.sample(3, 0).names == NAMES[:1]
    np.testing.assert_allclose(timeline.sample(3, 0).position, [0.03])
    assert not timeline.is_command.any()
