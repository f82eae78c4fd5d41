"""What a recorder had written when it was killed is read as far as it is whole, and the file stays as it is."""

from __future__ import annotations

import hashlib
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_recording

WRITER = """
import sqlite3, sys
from pathlib import Path
import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionMode, StoragePlugin, Writer as Writer2
from tests.recordings.bag_files import ROS1, ROS2, JointState, _built

form, path = sys.argv[1], Path(sys.argv[2])
ros1 = form == "bag"
store = ROS1 if ros1 else ROS2
if ros1:
    writer = Writer1(path)
else:
    writer = Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP if "mcap" in form else StoragePlugin.SQLITE3)
    if form == "mcap_zstd":
        from rosbags.rosbag2 import CompressionFormat
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
writer.open()
if form == "wal":
    writer.storage.conn.execute("PRAGMA journal_mode = WAL")
if form == "journal":  # what does not fit into a little memory goes to the file, uncommitted, beside its journal
    writer.storage.conn.execute("PRAGMA cache_size = 4")
names = [f"rh_FFJ{n}" for n in range(1, 5)] + [f"padding_{n:03d}" for n in range(100)]
connection = None
for number in range(10**9):
    message = JointState(1_700_000_000 * 10**9 + number * 8_000_000, names, [number * 1e-3] * len(names))
    kind, built = _built(message, store, ros1)
    connection = connection or writer.add_connection("/joint_states", kind, typestore=store)
    serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
    writer.write(connection, message.stamp_ns, bytes(serialize(built, kind)))
    if form in ("wal", "journal") and number % 500 == 499:
        writer.storage.conn.commit()
    if number and number % 2200 == 0:
        print(number, flush=True)
"""


def digests(folder: Path) -> dict[str, str]:
    return {
        str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*.*")
        if p.is_file()
    }


@pytest.mark.parametrize("form", ["mcap", "mcap_zstd", "bag", "journal", "wal"])
def test_what_is_whole_is_read_and_what_is_missing_is_said(form: str, tmp_path: Path) -> None:
    path = tmp_path / ("motion.bag.active" if form == "bag" else "motion")
    process = subprocess.Popen([sys.executable, "-c", WRITER, form, str(path)], stdout=subprocess.PIPE)
    assert process.stdout is not None
    with process:
        for _ in range(2):
            written = int(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
    before = digests(tmp_path)
    recording = load_recording(path)
    assert digests(tmp_path) == before
    assert 2000 < len(recording.stamp_ns) < written + 2200 * 8
    column = recording.position[:, recording.joints.index("rh_FFJ1")]
    assert column == pytest.approx(np.arange(len(column)) * 1e-3)
    (note,) = [note for note in recording.quality.notes if "killed" in note]
    assert "left out" in note


@pytest.mark.parametrize("keep", [0, 5, 60, 2000])
@pytest.mark.parametrize("form", ["mcap", "bag"])
def test_what_was_killed_before_its_first_piece_says_so(form: str, keep: int, tmp_path: Path) -> None:
    head = b"\x89MCAP0\r\n" if form == "mcap" else b"#ROSBAG V2.0\n"
    path = tmp_path / f"motion.{form}"
    path.write_bytes(head + bytes(keep))
    with pytest.raises(BadInput, match="recorder was killed"):
        load_recording(path)
