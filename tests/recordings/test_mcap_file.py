"""Recordings as they are written live: what is in the file at every moment, and who can read it."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from zlib import crc32

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.errors import BadInput
from twin_daemon.recordings import load_recording
from twin_daemon.recordings.mcap_file import MAGIC, StreamWriter
from twin_daemon.recordings.recover import recover

BEGIN_NS = 1_700_000_000_000_000_000
LATE_NS = 1_500_000
NAMES = ("rh_FFJ1", "rh_FFJ2")
TOPICS = ("joint_states", "joint_commands", "twin/joint_states", "twin/residual")


def fill(writer: StreamWriter, count: int, flush_each: int = 50) -> None:
    """`count` messages on each topic at 100 Hz; those of topic c are at c rad and arrive 1.5 ms late."""
    channels = [writer.add_channel(topic, key=f"a/{topic}") for topic in TOPICS]
    for number in range(count):
        stamp_ns = BEGIN_NS + number * 10_000_000
        for place, channel in enumerate(channels):
            sample = JointSample(stamp_ns, NAMES, np.array([place, 0.001 * number]))
            writer.write(channel, stamp_ns + LATE_NS, stamp_ns, cdr.encode(sample))
        if number % flush_each == flush_each - 1:
            writer.flush()


def records(content: bytes) -> list[tuple[int, int, bytes]]:
    """(place, kind, body) of each record between the two magics."""
    found, at = [], len(MAGIC)
    while at < len(content) - len(MAGIC):
        kind, size = struct.unpack_from("<BQ", content, at)
        found.append((at, kind, content[at + 9 : at + 9 + size]))
        at += 9 + size
    assert at == len(content) - len(MAGIC)
    return found


def test_the_extra_topics_are_neither_measured_nor_commanded(tmp_path: Path) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        fill(writer, 300)
    recording = load_recording(tmp_path / "r.mcap")
    assert recording.quality.measured_topic == "/joint_states"
    assert recording.quality.command_topics == ("/joint_commands",)
    assert (recording.position[:, 0] == 0.0).all()
    assert recording.commands is not None
    assert (recording.commands.position[:, 0] == 1.0).all()
    np.testing.assert_array_equal(recording.stamp_ns, BEGIN_NS + 10_000_000 * np.arange(300))


def test_a_prediction_alone_is_no_recording(tmp_path: Path) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        channels = {topic: writer.add_channel(topic) for topic in TOPICS}
        for topic in TOPICS[2:]:
            writer.write(channels[topic], BEGIN_NS, BEGIN_NS, cdr.encode(JointSample(BEGIN_NS, NAMES, np.zeros(2))))
    with pytest.raises(BadInput, match="no messages on /joint_states"):
        load_recording(tmp_path / "r.mcap")


def test_other_readers_find_topics_types_and_times_of_arrival(tmp_path: Path) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        fill(writer, 120)
    with AnyReader([tmp_path / "r.mcap"], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        assert {c.topic: (c.msgtype, c.msgcount) for c in reader.connections} == {
            f"/{topic}": ("sensor_msgs/msg/JointState", 120) for topic in TOPICS
        }
        read = [(received, reader.deserialize(raw, c.msgtype)) for c, received, raw in reader.messages()]
    assert len(read) == 480
    assert all(received == BEGIN_NS + LATE_NS + (i // 4) * 10_000_000 for i, (received, _) in enumerate(read))
    assert read[-1][1].position.tolist() == [3.0, 0.001 * 119]  # type: ignore[attr-defined]


def test_the_indexes_lead_to_the_messages_and_the_checksums_hold(tmp_path: Path) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        fill(writer, 120)
    content = (tmp_path / "r.mcap").read_bytes()
    assert content.startswith(MAGIC)
    assert content.endswith(MAGIC)
    found = records(content)
    by_place = {place: (kind, body) for place, kind, body in found}
    chunks = [body for _, kind, body in found if kind == 6]
    assert len(chunks) == 3
    for chunk in chunks:
        assert struct.unpack_from("<I", chunk, 24)[0] == crc32(chunk[40:])
    seen = 0
    for index in (body for _, kind, body in found if kind == 8):
        begin_ns, end_ns, place, length, size = struct.unpack_from("<QQQQI", index)
        kind, chunk = by_place[place]
        assert (kind, length) == (6, len(chunk) + 9)
        for channel, entries_at in struct.iter_unpack("<HQ", index[36 : 36 + size]):
            kind, entries = by_place[entries_at]
            assert (kind, struct.unpack_from("<H", entries)[0]) == (7, channel)
            for log_ns, offset in struct.iter_unpack("<QQ", entries[6:]):
                head = struct.unpack_from("<BQHIQQ", chunk[40:], offset)
                assert (head[0], head[2], head[4]) == (5, channel, log_ns)
                assert head[5] == log_ns - LATE_NS, "published when it was stamped"
                assert begin_ns <= log_ns <= end_ns
                seen += 1
    assert seen == 480
    footer_at, kind, footer = found[-1]
    assert kind == 2
    start, offsets, checksum = struct.unpack("<QQI", footer)
    assert crc32(content[start : footer_at + 9 + 16]) == checksum
    assert by_place[offsets][0] == 0x0E
    statistics = next(body for _, kind, body in found if kind == 0x0B)
    assert struct.unpack_from("<QHIIIIQQ", statistics) == (
        480, 1, 4, 0, 0, 3, BEGIN_NS + LATE_NS, BEGIN_NS + LATE_NS + 1_190_000_000,
    )  # fmt: skip


def test_a_message_without_a_stamp_is_published_when_it_arrived(tmp_path: Path) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        payload = cdr.encode(JointSample(0, NAMES, np.zeros(2)))
        writer.write(writer.add_channel("joint_states"), BEGIN_NS, 0, payload)
    chunk = next(body for _, kind, body in records((tmp_path / "r.mcap").read_bytes()) if kind == 6)
    assert struct.unpack_from("<QQ", chunk, 40 + 9 + 6) == (BEGIN_NS, BEGIN_NS)


def test_wherever_a_writer_is_cut_whole_chunks_come_back(tmp_path: Path, rng: np.random.Generator) -> None:
    writer = StreamWriter(tmp_path / "r.mcap")
    fill(writer, 200)
    writer.abandon()
    content = writer.part.read_bytes()
    chunk_at = content.index(b"\x06", content.rindex(b"a/twin/residual", 0, 4000))
    first_chunk_end = chunk_at + 9 + int.from_bytes(content[chunk_at + 1 : chunk_at + 9], "little")
    for number, end in enumerate(sorted(rng.integers(0, len(content), 25).tolist())):
        part, target = tmp_path / f"{number}.mcap.part", tmp_path / f"{number}-back.mcap"
        part.write_bytes(content[:end])
        if end < first_chunk_end:
            with pytest.raises(BadInput, match="no whole message"):
                recover(part, target)
            continue
        count = recover(part, target)
        assert count % 200 == 0
        assert count >= 800 * end / len(content) - 201, "at most the chunk that was cut is lost"
        assert load_recording(target).quality.messages == count // 4
        assert part.read_bytes() == content[:end]


def test_a_block_that_the_disk_lost_ends_the_recovery(tmp_path: Path) -> None:
    writer = StreamWriter(tmp_path / "r.mcap")
    fill(writer, 200)
    writer.abandon()
    content = bytearray(writer.part.read_bytes())
    content[len(content) // 2 : len(content) // 2 + 4096] = bytes(4096)
    writer.part.write_bytes(content)
    assert recover(writer.part, tmp_path / "back.mcap") in (200, 400)


def test_an_unfinished_file_is_not_read_as_a_whole_one(tmp_path: Path) -> None:
    writer = StreamWriter(tmp_path / "r.mcap")
    fill(writer, 200)
    with pytest.raises(BadInput, match="still being written"):
        recover(writer.part, tmp_path / "back.mcap")
    writer.abandon()
    with pytest.raises(BadInput, match="twin record --recover"):
        load_recording(writer.part)
    renamed = writer.part.rename(tmp_path / "renamed.mcap")
    (note,) = [note for note in load_recording(renamed).quality.notes if "killed" in note]
    assert "left out" in note
    assert not (tmp_path / "r.mcap").exists()


def test_nothing_is_overwritten_even_if_it_appears_late(tmp_path: Path) -> None:
    writer = StreamWriter(tmp_path / "r.mcap")
    with pytest.raises(BadInput, match="never finished"):
        StreamWriter(tmp_path / "r.mcap")
    fill(writer, 10)
    (tmp_path / "r.mcap").write_text("precious")
    with pytest.raises(BadInput, match="appeared"):
        writer.finish()
    assert (tmp_path / "r.mcap").read_text() == "precious"
    assert writer.part.exists()
    with pytest.raises(BadInput, match="exists already"):
        StreamWriter(tmp_path / "r.mcap")
    with pytest.raises(BadInput, match="folder"):
        StreamWriter(tmp_path / "nowhere" / "r.mcap")


@pytest.mark.parametrize("content", [b"", b"something else", MAGIC + b"\x06\x30" + bytes(7) + bytes(0x30)])
def test_what_is_no_recording_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "x.mcap.part").write_bytes(content)
    with pytest.raises(BadInput):
        recover(tmp_path / "x.mcap.part", tmp_path / "back.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap.part"]


@pytest.mark.parametrize("overlap_ns", [0, 400_000_000])
def test_chunks_that_overlap_in_time_are_read_in_the_order_of_receiving(tmp_path: Path, overlap_ns: int) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        channel = writer.add_channel("joint_states")
        for chunk in range(3):
            for number in range(100):
                stamp_ns = BEGIN_NS + (100 * chunk + number) * 10_000_000 - chunk * overlap_ns + chunk
                sample = JointSample(stamp_ns, NAMES, np.array([number, chunk]))
                writer.write(channel, stamp_ns, stamp_ns, cdr.encode(sample))
            writer.flush()
    recording = load_recording(tmp_path / "r.mcap")
    assert recording.quality.dropped == {}
    assert len(recording.stamp_ns) == 300


def indexed_falsely(content: bytes, entry: Callable[[int, int], int], kind: int = 7) -> bytes:
    """The file with what its indexes say of each message's place put through `entry` (number, place), or with the
    indexes under another kind of record. No checksum is over them."""
    changed = bytearray(content)
    for at, found, body in records(content):
        if found == 7:
            changed[at] = kind
            for number, here in enumerate(range(6, len(body), 16)):
                (place,) = struct.unpack_from("<Q", body, here + 8)
                struct.pack_into("<Q", changed, at + 9 + here + 8, entry(number, place))
    return bytes(changed)


@pytest.mark.parametrize(
    ("entry", "kind"),
    [
        (lambda number, place: 0, 7),
        (lambda number, place: place if number else 2**63 + place, 7),
        (lambda number, place: place + 1, 7),
        (lambda number, place: place if number % 2 else 2**40, 7),
        (lambda number, place: place, 0x7F),
    ],
    ids=["all the first", "beyond any file", "one byte late", "half of them far away", "of no known kind"],
)
def test_an_index_that_does_not_fit_hides_no_message_and_makes_none(
    tmp_path: Path, entry: Callable[[int, int], int], kind: int
) -> None:
    with StreamWriter(tmp_path / "r.mcap") as writer:
        fill(writer, 300)
    whole = load_recording(tmp_path / "r.mcap")
    content = (tmp_path / "r.mcap").read_bytes()
    (tmp_path / "false.mcap").write_bytes(indexed_falsely(content, entry, kind))
    found = load_recording(tmp_path / "false.mcap")
    np.testing.assert_array_equal(found.stamp_ns, whole.stamp_ns)
    np.testing.assert_array_equal(found.position, whole.position)
    assert found.commands is not None
    assert whole.commands is not None
    np.testing.assert_array_equal(found.commands.position, whole.commands.position)
