"""A recording that was made to harm: what unpacks without end, or computes what it is asked for, is refused."""

from __future__ import annotations

import gzip
import os
import sqlite3
import time
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from twin_daemon.errors import BadInput
from twin_daemon.recordings import budget, load, load_offered, load_recording, unpacking

from .bag_files import ROS1, ROS2, JointState, joint_state_bytes, write_bag

KIND = "sensor_msgs/msg/JointState"
LONG = JointState(10**18, ["a" * 20_000_000], [0.0])
MCAP, SQLITE3 = StoragePlugin.MCAP, StoragePlugin.SQLITE3


@pytest.fixture
def _little_slack(monkeypatch: pytest.MonkeyPatch) -> None:
    """So that a bomb of some megabytes is one."""
    monkeypatch.setattr(unpacking, "SLACK_BYTES", 2**20)


def refused(path: Path, said: str) -> None:
    with pytest.raises(BadInput, match=said) as caught:
        load_recording(path)
    assert "\n" not in str(caught.value)


@pytest.mark.usefixtures("_little_slack")
def test_a_text_that_says_the_same_for_ever(tmp_path: Path) -> None:
    lines = b'"[\'a\']","(0.0,)",(),(),1000\n' * 400_000
    path = tmp_path / "motion.csv.gz"
    path.write_bytes(gzip.compress(b"name,position,velocity,effort,timestamp_nsecs\n" + lines))
    refused(path, "unpack to more")


@pytest.mark.usefixtures("_little_slack")
def test_chunks_of_a_ros_1_bag(tmp_path: Path) -> None:
    path = tmp_path / "motion.bag"
    writer = Writer1(path)
    writer.set_compression(Writer1.CompressionFormat.BZ2)
    with writer:
        connection = writer.add_connection("/joint_states", KIND, typestore=ROS1)
        writer.write(connection, 10**18, joint_state_bytes(LONG, ros1=True))
    assert path.stat().st_size < 20_000
    refused(path, "unpack to more")


@pytest.mark.usefixtures("_little_slack")
@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (MCAP, CompressionMode.FILE),
        (MCAP, CompressionMode.MESSAGE),
        (MCAP, CompressionMode.STORAGE),
        (SQLITE3, CompressionMode.FILE),
        (SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_every_way_to_pack_a_ros_2_bag(storage: StoragePlugin, mode: CompressionMode, tmp_path: Path) -> None:
    path = tmp_path / "motion"
    writer = Writer2(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/joint_states", KIND, typestore=ROS2)
        writer.write(connection, 10**18, joint_state_bytes(LONG, ros1=False))
    assert sum(file.stat().st_size for file in path.iterdir()) < 60_000
    refused(path, "unpack to more")


@pytest.mark.parametrize(
    "made",
    [
        "CREATE VIEW more AS SELECT 1",
        "ALTER TABLE messages ADD COLUMN more BLOB AS (zeroblob(1000000000))",
        "CREATE VIRTUAL TABLE more USING rtree(a, b, c)",
        "CREATE TRIGGER more AFTER INSERT ON messages BEGIN SELECT 1; END",
    ],
)
def test_a_database_that_computes(made: str, tmp_path: Path) -> None:
    path = write_bag("db3_file", tmp_path, [JointState(10**18 + n * 10**6, ["a"], [0.1]) for n in range(60)])
    assert load_recording(path).quality.samples == 60
    with sqlite3.connect(path) as connection:
        connection.execute(made)
    connection.close()
    refused(path, "computes")


@pytest.mark.parametrize("name", ["../../secret.mcap", "/etc/passwd"])
def test_a_bag_that_names_files_elsewhere(name: str, tmp_path: Path) -> None:
    folder = write_bag("mcap", tmp_path, [JointState(10**18 + n * 10**6, ["a"], [0.1]) for n in range(60)])
    secret = write_bag("mcap_file", tmp_path, [JointState(10**18, ["secret"], [0.1])], "elsewhere")
    secret.rename(tmp_path.parent / "secret.mcap")
    about = folder / "metadata.yaml"
    about.write_text(about.read_text().replace("motion.mcap", name))
    refused(folder, "missing|EOF|not supported|passwd|secret")


HEADER = "name,position,velocity,effort,timestamp_nsecs\n"


@pytest.mark.parametrize("blank", ["\n", "\r\n", " \n"])
def test_lines_without_anything_cost_no_time(blank: str, tmp_path: Path) -> None:
    path = tmp_path / "motion.csv.gz"
    path.write_bytes(gzip.compress((HEADER + blank * 5_000_000).encode()))
    begin_s = time.process_time()
    refused(path, "lines are blank")
    assert time.process_time() - begin_s < 1.0  # all of them took longer


def test_a_blank_line_behind_every_other_is_no_attack(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(HEADER + "".join(f'"[\'a\']","({n},)",(),(),{10**18 + n * 10**6}\n\n' for n in range(3000)))
    assert load_recording(path).quality.samples == 3000


@pytest.mark.parametrize("form", ["csv", "pair", "bag", "mcap", "db3"])
def test_what_takes_too_long_is_left_whatever_its_form(
    form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stamps_ns = [10**18 + n * 10**6 for n in range(4000)]
    if form == "csv":
        path = tmp_path / "motion.csv"
        path.write_text(HEADER + "".join(f'"[\'a\']","(0.0,)",(),(),{stamp_ns}\n' for stamp_ns in stamps_ns))
    elif form == "pair":
        path = tmp_path
        (path / "joint_list.txt").write_text("a\n")
        lines = "".join(f'{stamp_ns // 1000},"(0.0,)"\n' for stamp_ns in stamps_ns)
        (path / "state_motor.csv").write_text("timestamp,positions\n" + lines)
    else:
        path = write_bag(form, tmp_path, [JointState(stamp_ns, ["a"], [0.1]) for stamp_ns in stamps_ns])
    assert load_recording(path).quality.samples == 4000
    with monkeypatch.context() as nothing_left:
        nothing_left.setattr(budget, "BASE_S", 0.0)
        nothing_left.setattr(budget, "PER_MIB_S", 0.0)
        refused(path, "of the processor")
    monkeypatch.setattr(budget, "MOST_MESSAGES", 1000)
    refused(path, "more than 1000 messages")


def recording_in(folder: Path, form: str) -> Path:
    stamps_ns = [10**18 + n * 10**6 for n in range(60)]
    if form == "csv":
        path = folder / "motion.csv"
        path.write_text(HEADER + "".join(f'"[\'a\']","(0.0,)",(),(),{stamp_ns}\n' for stamp_ns in stamps_ns))
        return path
    if form == "pair":
        (folder / "joint_list.txt").write_text("a\n")
        path = folder / "motion"
        path.mkdir()
        lines = "".join(f'{stamp_ns // 1000},"(0.0,)"\n' for stamp_ns in stamps_ns)
        (path / "state_motor.csv").write_text("timestamp,positions\n" + lines)
        return path
    return write_bag(form, folder, [JointState(stamp_ns, ["a"], [0.1]) for stamp_ns in stamps_ns])


@pytest.mark.parametrize("form", ["csv", "pair", "bag", "mcap", "mcap_file", "mcap_zstd", "db3", "db3_file"])
def test_what_is_offered_is_read_as_it_lies_in_its_folder_and_through_no_link(form: str, tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    path = recording_in(tmp_path / "elsewhere", form)
    plain, offered = load_recording(path), load_offered(path)
    assert (offered.name, offered.path, offered.sha256) == (plain.name, plain.path, plain.sha256)
    assert (offered.position == plain.position).all()
    link = tmp_path / path.name
    link.symlink_to(path)
    with pytest.raises(BadInput, match="is a link"):
        load_offered(link)
    if not path.is_dir():
        return
    inside = next(file for file in path.iterdir() if file.name != "metadata.yaml")
    inside.rename(tmp_path / "taken")
    inside.symlink_to(tmp_path / "taken")
    load_recording(path)
    with pytest.raises(BadInput, match="is a link") as caught:
        load_offered(path)
    assert str(inside) in str(caught.value)
    inside.unlink()
    os.mkfifo(inside)
    with pytest.raises(BadInput, match="not a file"):
        load_offered(path)


def test_a_file_that_becomes_a_link_while_it_is_read_is_the_one_that_was_opened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = recording_in(tmp_path, "csv")
    (tmp_path / "secret.csv").write_text(f"root:hunter2\n{HEADER}")
    read = load.load_recording

    def swapped(held: Path, *more: Any) -> Any:
        path.unlink()
        path.symlink_to(tmp_path / "secret.csv")
        return read(held, *more)

    monkeypatch.setattr(load, "load_recording", swapped)
    with pytest.raises(BadInput, match="replaced") as caught:
        load_offered(path)
    assert "hunter2" not in str(caught.value)


SECRETS = [
    "root:hunter2:0:0\nmore: 'hunter2'\n",
    "token = hunter2",
    "name,position,hunter2\n['hunter2'],(hunter2),hunter2\n",
    "hunter2: [hunter2\n",
    "hunter2: !hunter2 'x'\n",
    "rosbag2_bagfile_information: {version: hunter2}\n",
    "rosbag2_bagfile_information: {version: 5, relative_file_paths: [], storage_identifier: hunter2}\n",
    "hunter2: 1\nhunter2: 2\n",
]


@pytest.mark.parametrize("text", SECRETS)
@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a/control.csv", "a/metadata.yaml", "a.mcap", "a.db3", "a.bag"])
def test_what_is_no_recording_is_not_quoted(text: str, name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.parent.mkdir(exist_ok=True)
    path.write_text(text)
    if path.name == "control.csv":
        path.with_name("state_motor.csv").write_text(text)
        path.with_name("joint_list.txt").write_text(text)
    shown = path if path.parent == tmp_path else path.parent
    for read in (load_recording, load_offered):
        with pytest.raises(BadInput) as caught:
            read(shown)
        assert "hunter2" not in str(caught.value)
