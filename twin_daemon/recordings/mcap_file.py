"""MCAP as it is written while messages arrive.

Beside `McapWriter` because a live recording needs what a bag made afterwards does not: the time of arrival and the
stamp of each message, bytes as they came, and pieces on the disk that survive a kill. The format: mcap.dev/spec.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
from collections import Counter
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import TracebackType
from zlib import crc32

from rosbags.typesys import Stores, get_typestore

from twin_daemon.errors import BadInput
from twin_daemon.files import sync_folder
from twin_daemon.recordings.joint_state_wire import JOINT_STATE

PART = ".part"  # behind the final name while a recording is being written
MAGIC = b"\x89MCAP0\r\n"
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
STATISTICS, SUMMARY_OFFSET, DATA_END = 0x0B, 0x0E, 0x0F
MESSAGE_OVERHEAD = 31 + 16  # bytes around the payload, and of its entry in the index
_CHUNK_BYTES = 2**20
_SCHEMA_ID = 1
RECORD_HEAD = struct.Struct("<BQ")  # kind, and bytes that follow
MESSAGE_HEAD = struct.Struct("<HIQQ")


@dataclass
class _Chunk:
    """Messages that wait to be written as one piece."""

    records: bytearray = field(default_factory=bytearray)
    begin_ns: int = 2**63 - 1
    end_ns: int = 0
    index: dict[int, bytearray] = field(default_factory=dict)


class StreamWriter:
    """sensor_msgs/JointState bytes into one .mcap file, under the name with `.part` until it is finished.

    What has been flushed survives a kill: `recover.recover` copies it out of the .part. The final name appears only
    with a whole file. Raises BadInput if either name is there already. Not for several threads at once.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.part = path.with_name(path.name + PART)
        self.bytes = 0
        self._count: Counter[int] = Counter()
        self._channels: list[bytes] = []
        self._chunk = _Chunk()
        self._chunk_indexes: list[bytes] = []
        self._span_ns = (2**63 - 1, 0)
        refuse_existing(path)
        try:
            self._file = self.part.open("xb")
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", where=self.part) from None
        with contextlib.suppress(OSError):  # not every network folder has locks; they only warn whoever recovers
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._put(MAGIC + _record(HEADER, _text("ros2") + _text("twin_daemon")))
        self._schema = _record(SCHEMA, struct.pack("<H", _SCHEMA_ID) + _schema())
        self._put(self._schema)

    def __enter__(self) -> StreamWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self.finish()
        else:
            self.abandon()

    @property
    def messages(self) -> int:
        return self._count.total()

    def add_channel(self, topic: str, **about: str) -> int:
        """Declares a topic of joint states, with words `about` it; the number to write to it with."""
        number = len(self._channels) + 1
        words = b"".join(_text(key) + _text(value) for key, value in about.items())
        name = _text("/" + topic.strip("/"))
        self._channels.append(
            _record(CHANNEL, struct.pack("<HH", number, _SCHEMA_ID) + name + _text("cdr") + _sized(words))
        )
        self._put(self._channels[-1])
        return number

    def write(self, channel: int, log_ns: int, publish_ns: int, payload: bytes) -> None:
        """One message: when it arrived, when it was stamped (0 or less: not at all), and its CDR bytes."""
        chunk = self._chunk
        entry = struct.pack("<QQ", log_ns, len(chunk.records))
        chunk.index.setdefault(channel, bytearray()).extend(entry)
        head = MESSAGE_HEAD.pack(channel, self._count[channel], log_ns, publish_ns if publish_ns > 0 else log_ns)
        chunk.records += _record(MESSAGE, head + payload)
        chunk.begin_ns, chunk.end_ns = min(chunk.begin_ns, log_ns), max(chunk.end_ns, log_ns)
        self._count[channel] += 1
        if len(chunk.records) >= _CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Gives what was written so far to the operating system, so that it survives this process."""
        chunk = self._chunk
        if not chunk.records:
            return
        self._chunk = _Chunk()
        records, times = bytes(chunk.records), struct.pack("<QQ", chunk.begin_ns, chunk.end_ns)
        size = struct.pack("<Q", len(records))
        start = self.bytes
        self._put(_record(CHUNK, times + size + struct.pack("<I", crc32(records)) + _text("") + size + records))
        end, places = self.bytes, b""
        for channel, entries in chunk.index.items():
            places += struct.pack("<HQ", channel, self.bytes)
            self._put(_record(MESSAGE_INDEX, struct.pack("<H", channel) + _sized(bytes(entries))))
        place = struct.pack("<QQ", start, end - start) + _sized(places) + struct.pack("<Q", self.bytes - end)
        self._chunk_indexes.append(_record(CHUNK_INDEX, times + place + _text("") + size + size))
        self._span_ns = min(self._span_ns[0], chunk.begin_ns), max(self._span_ns[1], chunk.end_ns)
        self._file.flush()

    def finish(self) -> None:
        """Completes the file, makes it survive a loss of power, and gives it its name. Never replaces a file."""
        with self._file:
            self.flush()
            self._put(_record(DATA_END, struct.pack("<I", 0)))
            self._put(self._summary(self.bytes) + MAGIC)
            self._file.flush()
            os.fsync(self._file.fileno())
        try:
            _name(self.part, self.path)
        except FileExistsError:
            raise BadInput(
                "appeared while the recording was written", where=self.path, todo=f"The recording is {self.part}"
            ) from None
        sync_folder(self.path.parent)

    def abandon(self) -> None:
        """Ends as if it had been killed: what was flushed stays in the .part."""
        with contextlib.suppress(OSError):  # a full disk, again
            self._file.close()

    def discard(self) -> None:
        """Removes the unfinished file."""
        self.abandon()
        self.part.unlink(missing_ok=True)

    def _summary(self, start: int) -> bytes:
        """All between the data and the last magic: schema, channels, chunk indexes, statistics, where they are."""
        counts = b"".join(struct.pack("<HQ", channel, count) for channel, count in sorted(self._count.items()))
        numbers = (self.messages, 1, len(self._channels), 0, 0, len(self._chunk_indexes))
        times = self._span_ns if self.messages else (0, 0)
        groups = (
            (SCHEMA, self._schema),
            (CHANNEL, b"".join(self._channels)),
            (CHUNK_INDEX, b"".join(self._chunk_indexes)),
            (STATISTICS, _record(STATISTICS, struct.pack("<QHIIIIQQ", *numbers, *times) + _sized(counts))),
        )
        content = offsets = b""
        for kind, records in groups:
            if records:
                where = struct.pack("<BQQ", kind, start + len(content), len(records))
                offsets += _record(SUMMARY_OFFSET, where)
                content += records
        content, offsets_at = content + offsets, start + len(content)
        footer = struct.pack("<BQQQ", FOOTER, 20, start, offsets_at)
        return content + footer + struct.pack("<I", crc32(content + footer))

    def _put(self, content: bytes) -> None:
        self._file.write(content)
        self.bytes += len(content)


def refuse_existing(path: Path) -> None:
    """Raises BadInput unless a recording can begin under this name."""
    part = path.with_name(path.name + PART)
    if path.exists() or path.is_symlink():
        raise BadInput("exists already", where=path, todo="Choose another name or remove it")
    if part.exists() or part.is_symlink():
        todo = f"Choose another name; what a killed recorder left comes back with 'twin record --recover {part}'"
        raise BadInput("is being written, or was never finished", where=part, todo=todo)
    if not path.absolute().parent.is_dir():
        raise BadInput("the folder for the recording does not exist", where=path.parent, todo="Create it")


def _name(part: Path, path: Path) -> None:
    try:
        os.link(part, path)  # unlike a renaming, this never replaces a file that appeared meanwhile
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if path.exists():
            raise FileExistsError from None
        part.rename(path)
    else:
        part.unlink()


def _record(kind: int, body: bytes) -> bytes:
    return RECORD_HEAD.pack(kind, len(body)) + body


def _sized(content: bytes) -> bytes:
    return struct.pack("<I", len(content)) + content


def _text(text: str) -> bytes:
    return _sized(text.encode())


@cache
def _schema() -> bytes:
    """The definition that Foxglove and PlotJuggler read the numbers by."""
    definition, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(JOINT_STATE, ros_version=2)
    return _text(JOINT_STATE) + _text("ros2msg") + _text(definition)
