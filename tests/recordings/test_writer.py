"""What the writer writes is a ROS 2 bag that others open, whole or absent."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from twin_daemon.errors import BadInput
from twin_daemon.recordings import McapWriter, load_recording

START = 1_700_000_000_123_456_789
NAMES = ["rh_FFJ1", "rh_FFJ2", "rh_FFJ3"]


@pytest.mark.parametrize("name", ["motion", "motion.mcap", "two.dots"])
def test_round_trip_is_exact(name: str, tmp_path: Path, rng: np.random.Generator) -> None:
    position, velocity, effort = rng.normal(size=(3, 200, 3))
    targets = rng.normal(size=(50, 2))
    with McapWriter(tmp_path / name) as writer:
        for i in range(200):
            writer.joint_states(
                START + i * 1_000_000, NAMES, position[i], velocity[i], effort[i], topic="rh/joint_states"
            )
            writer.joint_states(START + i * 1_000_000, NAMES, position[i] * 0, topic="twin/rh/joint_states")
            if i % 4 == 0:
                writer.joint_commands(START + i * 1_000_000, ["rh_FFJ0", "rh_FFJ3"], targets[i // 4])
    recording = load_recording(tmp_path / name)
    np.testing.assert_array_equal(recording.stamp_ns, START + np.arange(200) * 1_000_000)
    np.testing.assert_array_equal(recording.position, position)
    np.testing.assert_array_equal(recording.velocity, velocity)
    np.testing.assert_array_equal(recording.effort, effort)
    assert recording.joints == tuple(NAMES)
    assert recording.commands is not None
    assert recording.commands.names == ("rh_FFJ0", "rh_FFJ3")
    np.testing.assert_array_equal(recording.commands.position, targets)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_other_tools_find_topics_types_and_metadata(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "motion") as writer:
        writer.add_topic("silent")
        writer.joint_states(START, NAMES, [1, 2, 3], received_ns=START + 5)
    assert (tmp_path / "motion" / "metadata.yaml").exists()
    with AnyReader([tmp_path / "motion"]) as reader:
        assert {(c.topic, c.msgtype) for c in reader.connections} == {
            ("/joint_states", "sensor_msgs/msg/JointState"),
            ("/silent", "sensor_msgs/msg/JointState"),
        }
        ((connection, received_ns, raw),) = reader.messages()
        message = reader.deserialize(raw, connection.msgtype)
    assert received_ns == START + 5
    assert message.name == NAMES  # type: ignore[attr-defined]
    assert len(message.velocity) == 0  # type: ignore[attr-defined]


def test_a_failure_while_writing_leaves_nothing(tmp_path: Path) -> None:
    def interrupted() -> None:
        with McapWriter(tmp_path / "motion.mcap") as writer:
            writer.joint_states(START, NAMES, [1, 2, 3])
            raise RuntimeError("interrupted")

    with pytest.raises(RuntimeError, match="interrupted"):
        interrupted()
    assert list(tmp_path.iterdir()) == []


def test_a_killed_writer_leaves_nothing_under_the_final_name(tmp_path: Path) -> None:
    script = f"""
        from twin_daemon.recordings import McapWriter
        with McapWriter({str(tmp_path / "motion")!r}) as writer:
            for i in range(5000):
                writer.joint_states({START} + i, ["a"], [1.0])
            print("writing", flush=True)
            input()
    """
    process = subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == "writing\n"
        process.send_signal(signal.SIGKILL)
    assert not (tmp_path / "motion").exists()


def test_what_exists_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "motion.mcap").write_text("precious")
    with pytest.raises(BadInput, match="exists"):
        McapWriter(tmp_path / "motion.mcap")
    with pytest.raises(BadInput, match="folder"):
        McapWriter(tmp_path / "nowhere" / "motion.mcap")
    assert (tmp_path / "motion.mcap").read_text() == "precious"


def test_what_contradicts_itself_is_not_written(tmp_path: Path) -> None:
    with McapWriter(tmp_path / "motion") as writer:
        for stamp_ns, position, velocity in ((START, [1, 2], None), (START, [1, 2, 3], [1]), (-1, [1, 2, 3], None)):
            with pytest.raises(BadInput):
                writer.joint_states(stamp_ns, NAMES, position, velocity)
        writer.joint_states(START, NAMES, [1, 2, 3])
    assert load_recording(tmp_path / "motion").quality.messages == 1
