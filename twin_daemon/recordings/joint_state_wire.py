"""sensor_msgs/JointState from the bytes of ROS 1 and ROS 2, fast where messages repeat their layout.

A general decoder needs 25 us a message. Nearly all messages of a recording differ only in their stamp and their
numbers, so the first one of a layout is decoded in general, its layout is verified against that, and all that follow
are compared byte for byte outside the numbers and read in bulk. Whatever differs goes the general way.
"""

from __future__ import annotations

import struct
from collections import Counter
from dataclasses import dataclass

import numpy as np
from rosbags.typesys.store import Typestore

from twin_daemon.recordings.batch import Batch
from twin_daemon.recordings.rows import Block, Rows

JOINT_STATE = "sensor_msgs/msg/JointState"
SECOND_NS = 1_000_000_000
_BULK = 1024  # messages that come one by one and are read together
_MAX_LAYOUTS = 64  # beyond that the sender is not repeating itself, and looking for layouts costs more than it saves
_STAMP_AT = 4  # behind the CDR header in ROS 2, behind seq in ROS 1
_HEAD_AT = 12
_U32 = struct.Struct("<I")


@dataclass
class _Layout:
    """Where the numbers of messages with the same other bytes stand, and the messages that wait for bulk reading."""

    size: int
    start: bytes | None  # the CDR header; None in ROS 1, where seq stands there
    head: bytes  # from the frame to the number of positions, names included
    position_at: int
    velocity_at: int  # where their numbers are counted, and the counts as they stand there
    velocities: bytes
    effort_at: int
    efforts: bytes
    dtype: np.dtype
    refused: str | None
    ignored: tuple[str, ...]
    rows: Rows | None

    def fitting(self, rows: np.ndarray) -> np.ndarray:
        """Which of many messages (n, size) uint8 have this layout: (n,) bool."""
        parts = [(_HEAD_AT, self.head), (self.velocity_at, self.velocities), (self.effort_at, self.efforts)]
        if self.start is not None:
            parts.append((0, self.start))
        same = [(rows[:, at : at + len(part)] == np.frombuffer(part, np.uint8)).all(axis=1) for at, part in parts]
        return np.logical_and.reduce(same)


@dataclass(frozen=True)
class _Message:
    stamp_ns: int
    names: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


class JointStateReader:
    """Collects the joint states of one topic. Bytes go in with `feed`, rows come out of `finish`.

    `expected` is how many messages are announced; nothing depends on its truth but time.
    """

    def __init__(
        self, typestore: Typestore, *, ros1: bool, dropped: Counter[str], fast: bool = True, expected: int = 0
    ) -> None:
        self._typestore = typestore
        self._ros1 = ros1
        self._dropped = dropped
        self._fast = fast
        self._expected = expected
        self._layouts: dict[int, list[_Layout]] = {}  # by size of the message
        self._known_layouts = 0
        self._rows: dict[tuple[tuple[str, ...], bool, bool], Rows] = {}
        self._waiting: list[tuple[bytes, int]] = []
        self._first: dict[tuple[tuple[str, ...], bool, bool], int] = {}
        self.messages = 0

    def feed(self, raw: bytes, received_ns: int) -> None:
        """One message as it stands in the file; `received_ns` is when it was recorded."""
        self._waiting.append((raw, received_ns))
        if len(self._waiting) >= _BULK:
            self._flush()

    def feed_batch(self, batch: Batch) -> None:
        """Many messages at once, as a file holds them."""
        self._flush()
        self._take(batch)

    def _flush(self) -> None:
        if not self._waiting:
            return
        raw, received_ns = zip(*self._waiting, strict=True)
        self._waiting = []
        end = np.cumsum([len(message) for message in raw])
        begin = end - [len(message) for message in raw]
        self._take(Batch(b"".join(raw), np.zeros(len(raw), dtype=int), begin, end, np.array(received_ns)))

    def _take(self, batch: Batch) -> None:
        size = batch.end - batch.begin
        order = self.messages + np.arange(len(size))
        self.messages += len(size)
        for each in np.unique(size).tolist():
            alike = np.flatnonzero(size == each)
            content = np.frombuffer(batch.content, np.uint8)
            rows = np.lib.stride_tricks.sliding_window_view(content, each)[batch.begin[alike]] if each else content[:0]
            self._feed_alike(rows.reshape(len(alike), each), batch.received_ns[alike], order[alike])

    def _feed_alike(self, rows: np.ndarray, received_ns: np.ndarray, order: np.ndarray) -> None:
        """Messages of one size (n, size) uint8."""
        waiting = np.ones(len(rows), dtype=bool)

        def take(layout: _Layout) -> None:
            fitting = layout.fitting(rows) & waiting
            if fitting.any():
                self._read(layout, rows if fitting.all() else rows[fitting], received_ns[fitting], order[fitting])
                waiting[fitting] = False

        for layout in self._layouts.get(rows.shape[1], ()):
            take(layout)
        while waiting.any():
            first = int(waiting.argmax())
            waiting[first] = False
            known = self._known_layouts
            self._general(rows[first].tobytes(), int(received_ns[first]), int(order[first]))
            if self._known_layouts > known:
                take(self._layouts[rows.shape[1]][-1])

    def finish(self) -> list[Rows]:
        """All rows, one for each kind of message, in the order in which the kinds appeared."""
        self._flush()
        return [self._rows[key] for key in sorted(self._rows, key=self._first.__getitem__)]

    def _general(self, raw: bytes, received_ns: int, order: int) -> None:
        try:
            message = self._decode(raw)
        except Exception:  # foreign bytes break a decoder in every way there is
            self._dropped["undecodable"] += 1
            return
        refused, ignored = _judge(message)
        has_velocity = len(message.velocity) == len(message.names)
        has_effort = len(message.effort) == len(message.names)
        rows = None
        if refused is None:
            key = (message.names, has_velocity, has_effort)
            if key not in self._rows:
                room = 0 if self._rows else self._expected  # nearly always all messages are of one kind
                self._rows[key] = Rows(message.names, velocity=has_velocity, effort=has_effort, expected=room)
            rows = self._rows[key]
            self._first[key] = min(order, self._first.get(key, order))
            rows.add(message.stamp_ns, received_ns, order, message.position, message.velocity, message.effort)
        self._count(refused, ignored, 1)
        if self._fast and self._known_layouts < _MAX_LAYOUTS:
            layout = _learn(raw, message, rows, self._ros1, refused, ignored)
            if layout is not None:
                self._layouts.setdefault(len(raw), []).append(layout)
                self._known_layouts += 1

    def _decode(self, raw: bytes) -> _Message:
        decode = self._typestore.deserialize_ros1 if self._ros1 else self._typestore.deserialize_cdr
        message = decode(raw, JOINT_STATE)
        stamp = message.header.stamp  # type: ignore[attr-defined]
        return _Message(
            int(stamp.sec) * SECOND_NS + int(stamp.nanosec),
            tuple(message.name),  # type: ignore[attr-defined]
            np.array(message.position, dtype=np.float64),  # type: ignore[attr-defined]
            np.array(message.velocity, dtype=np.float64),  # type: ignore[attr-defined]
            np.array(message.effort, dtype=np.float64),  # type: ignore[attr-defined]
        )

    def _read(self, layout: _Layout, rows: np.ndarray, received_ns: np.ndarray, order: np.ndarray) -> None:
        """Messages (n, size) uint8 that all fit a layout."""
        if layout.rows is not None:
            read = rows.view(layout.dtype)[:, 0]
            joints = len(layout.rows.names)
            layout.rows.add_block(
                Block(
                    read["sec"].astype(np.int64) * SECOND_NS + read["nanosec"],
                    received_ns,
                    order,
                    read["position"],
                    read["velocity"] if read["velocity"].shape[1] == joints else None,
                    read["effort"] if read["effort"].shape[1] == joints else None,
                )
            )
        self._count(layout.refused, layout.ignored, len(rows))

    def _count(self, refused: str | None, ignored: tuple[str, ...], count: int) -> None:
        for kind in (refused,) if refused is not None else ignored:
            self._dropped[kind] += count


def _judge(message: _Message) -> tuple[str | None, tuple[str, ...]]:
    """Why a message cannot be used at all (or None), and which of its arrays have to be left out."""
    joints = len(message.names)
    if len(message.position) != joints:
        return "wrong_length", ()
    if not joints:
        return "empty", ()
    if len(set(message.names)) != joints:
        return "repeated_names", ()
    arrays = (("velocity", message.velocity), ("effort", message.effort))
    return None, tuple(f"{key}_wrong_length" for key, values in arrays if len(values) not in (0, joints))


def _learn(
    raw: bytes, message: _Message, rows: Rows | None, ros1: bool, refused: str | None, ignored: tuple[str, ...]
) -> _Layout | None:
    """The layout of a message, if reading it by that layout gives exactly what the general decoder gave."""
    if not ros1 and raw[:2] != b"\x00\x01":
        return None  # big-endian: rare enough for the general way
    try:
        places, end = _places(raw, len(message.names), ros1)
    except (struct.error, IndexError):
        return None
    (count_at, _, positions), (velocity_at, _, _), (effort_at, _, _) = places
    layout = _Layout(
        size=len(raw),
        start=None if ros1 else raw[:4],
        head=raw[_HEAD_AT : count_at + 4],
        position_at=count_at + 4,
        velocity_at=velocity_at,
        velocities=raw[velocity_at : velocity_at + 4],
        effort_at=effort_at,
        efforts=raw[effort_at : effort_at + 4],
        dtype=np.dtype(
            {
                "names": ["sec", "nanosec", "position", "velocity", "effort"],
                "formats": ["<u4" if ros1 else "<i4", "<u4", *(("<f8", (count,)) for _, _, count in places)],
                "offsets": [_STAMP_AT, _STAMP_AT + 4, *(at for _, at, _ in places)],
                "itemsize": len(raw),
            }
        ),
        refused=refused,
        ignored=ignored,
        rows=rows,
    )
    if end > len(raw) or positions != len(message.position):
        return None
    read = np.frombuffer(raw, dtype=layout.dtype)
    same = int(read["sec"][0]) * SECOND_NS + int(read["nanosec"][0]) == message.stamp_ns and all(
        read[key][0].tobytes() == getattr(message, key).tobytes() for key in ("position", "velocity", "effort")
    )
    return layout if same else None


def _places(raw: bytes, joints: int, ros1: bool) -> tuple[list[tuple[int, int, int]], int]:
    """(place of the length, place of the numbers, how many) for position, velocity and effort; end of the last."""

    def aligned(at: int, width: int) -> int:
        return at if ros1 else 4 + (at - 4 + width - 1) // width * width  # CDR aligns behind its header of 4 bytes

    at = _HEAD_AT
    at += 4 + _U32.unpack_from(raw, at)[0]  # the frame
    at = aligned(at, 4) + 4
    for _ in range(joints):
        at = aligned(at, 4)
        at += 4 + _U32.unpack_from(raw, at)[0]
    places = []
    for _ in range(3):
        count_at = aligned(at, 4)
        count = _U32.unpack_from(raw, count_at)[0]
        at = count_at + 4
        values_at = aligned(at, 8) if count else at
        at = values_at + 8 * count
        if at > len(raw):
            raise IndexError("numbers beyond the end of the message")
        places.append((count_at, values_at, count))
    return places, at
