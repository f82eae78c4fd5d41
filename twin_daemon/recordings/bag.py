"""What the topics of a bag say, whichever format the bag has: measured joints, and commands in any of three forms."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from rosbags.interfaces import Connection
from rosbags.typesys.store import Typestore

from twin_daemon.errors import BadInput
from twin_daemon.recordings.assemble import Stream, assemble
from twin_daemon.recordings.budget import spend
from twin_daemon.recordings.controller_topics import joint_of_topic
from twin_daemon.recordings.joint_state_wire import JOINT_STATE, SECOND_NS, JointStateReader
from twin_daemon.recordings.mcap_chunks import ChunkedBag
from twin_daemon.recordings.recording import Commands
from twin_daemon.recordings.rows import Rows
from twin_daemon.recordings.trajectory_commands import TrajectoryMessage, expand_trajectories

JOINT_TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
FLOAT64 = "std_msgs/msg/Float64"
_EVERY = 256
_FAR_NS = SECOND_NS  # a joint measured longer ago than this does not say where a trajectory sets out from


class BagReader(Protocol):
    """The part of the rosbags readers that is used here."""

    @property
    def connections(self) -> list[Connection]: ...

    def messages(self, connections: Any) -> Iterable[tuple[Connection, int, bytes]]: ...


Feed = JointStateReader | Callable[[bytes, int], None]
"""What takes the messages of a topic: bytes, and when they were received."""


@dataclass
class Contents:
    """What a reader found: the streams, and what there is to say about them."""

    measured: Stream
    messages: int
    commands: Commands | None = None
    dropped: Counter[str] = field(default_factory=Counter)
    commands_dropped: Counter[str] = field(default_factory=Counter)
    measured_topic: str | None = None
    command_topics: tuple[str, ...] = ()
    notes: list[str] = field(default_factory=list)


def read_topics(reader: BagReader | ChunkedBag, typestore: Typestore, *, ros1: bool) -> Contents:
    """Measured joints and commands of an open bag, in one pass. Topics of other types are never looked into."""
    usable = [c for c in reader.connections if getattr(c.ext, "serialization_format", "cdr") == "cdr"]
    measured_topic, others = _measured_topic(usable)
    notes = [f"measured: {measured_topic}; not used: {', '.join(others)}"] if others else []
    dropped: Counter[str] = Counter()
    announced = sum(c.msgcount for c in usable if (c.topic, c.msgtype) == (measured_topic, JOINT_STATE))
    joint_states = JointStateReader(typestore, ros1=ros1, dropped=dropped, expected=announced)
    source = _command_source(usable, measured_topic, typestore, ros1)

    def feed_of(connection: Connection) -> Feed | None:
        if connection.topic == measured_topic and connection.msgtype == JOINT_STATE:
            return joint_states
        if source is not None and (connection.topic, connection.msgtype) in source.topics:
            return source.feed_of(connection.topic)
        return None

    _distribute(reader, {c.id: feed for c in usable if (feed := feed_of(c)) is not None})
    measured = assemble(joint_states.finish(), dropped)
    if measured is None:
        what = f"none of the {joint_states.messages} messages on {measured_topic} can be used ({_counts(dropped)})"
        raise BadInput(
            what if joint_states.messages else f"no messages on {measured_topic}", todo="Record the hand in motion"
        )
    if measured.by_receive_time:
        notes.append(f"{measured_topic}: no header stamps, so the times are those of receiving, with their jitter")
    contents = Contents(measured, joint_states.messages, dropped=dropped, measured_topic=measured_topic, notes=notes)
    if source is not None:
        contents.commands = source.commands(measured)
        contents.commands_dropped = source.dropped
        contents.command_topics = tuple(sorted({topic for topic, _ in source.topics}))
        notes += source.notes
    return contents


def _distribute(reader: BagReader | ChunkedBag, feeds: dict[int, Feed]) -> None:
    """Gives the messages of each connection to its feed."""
    readers = [feed for feed in dict.fromkeys(feeds.values()) if isinstance(feed, JointStateReader)]
    single = {id_: feed.feed if isinstance(feed, JointStateReader) else feed for id_, feed in feeds.items()}
    if not isinstance(reader, ChunkedBag):
        wanted = [c for c in reader.connections if c.id in feeds]
        for number, (connection, received_ns, raw) in enumerate(reader.messages(wanted), 1):
            single[connection.id](raw, received_ns)
            if number % _EVERY == 0:
                spend(_EVERY)
        return
    others = [id_ for id_, feed in feeds.items() if not isinstance(feed, JointStateReader)]
    for batch in reader.batches(feeds):
        for each in readers:
            each.feed_batch(batch.of([id_ for id_, feed in feeds.items() if feed is each]))
        for id_, received_ns, raw in batch.of(others).messages():
            single[id_](raw, received_ns)


def _counts(dropped: Counter[str]) -> str:
    return ", ".join(f"{count} {kind}" for kind, count in sorted(dropped.items()))


def _measured_topic(connections: Sequence[Connection]) -> tuple[str, list[str]]:
    """The topic of the measured joints, and the other ones that might have been meant."""
    joint_topics = sorted({c.topic for c in connections if c.msgtype == JOINT_STATE})
    found = [topic for topic in joint_topics if topic.endswith("joint_states")]
    if not found:
        listed = ", ".join(joint_topics) if joint_topics else "no topic of that type"
        raise BadInput(
            f"no sensor_msgs/JointState topic named joint_states (there is {listed})",
            allowed="a topic ending in joint_states",
            todo="Record it with the commands, for example with twin record",
        )
    count = Counter({topic: sum(c.msgcount for c in connections if c.topic == topic) for topic in found})

    def rank(topic: str) -> tuple[bool, bool, bool, int, int, str]:
        parts = topic.strip("/").split("/")
        # twin/<hand>/joint_states is a prediction that was recorded beside the hand
        return (parts[0] == "twin", not count[topic], parts[-1] != "joint_states", len(parts), -count[topic], topic)

    best, *others = sorted(found, key=rank)
    return best, others


class _Source(Protocol):
    topics: set[tuple[str, str]]
    dropped: Counter[str]
    notes: list[str]

    def feed_of(self, topic: str) -> Feed: ...

    def commands(self, measured: Stream) -> Commands | None: ...


def _command_source(
    connections: Sequence[Connection], measured_topic: str, typestore: Typestore, ros1: bool
) -> _Source | None:
    """The commands to read: streamed joint commands before trajectories before single controllers.

    A lower form in the same bag is what the higher one was made from, or made of, so that one of them is enough.
    """
    filled = [c for c in connections if c.msgcount]
    streamed = sorted({c.topic for c in filled if c.msgtype == JOINT_STATE and c.topic.endswith("joint_commands")})
    if streamed:
        prefix = measured_topic.rpartition("/")[0].strip("/")
        topic = min(streamed, key=lambda name: (name.rpartition("/")[0].strip("/") != prefix, len(name), name))
        return _Streamed(topic, typestore, ros1, [name for name in streamed if name != topic])
    trajectories = {(c.topic, c.msgtype) for c in filled if c.msgtype == JOINT_TRAJECTORY}
    if trajectories:
        return _Trajectories(trajectories, typestore, ros1)
    single = {(c.topic, c.msgtype) for c in filled if c.msgtype == FLOAT64 and joint_of_topic(c.topic, ()) is not None}
    return _Controllers(single, ros1) if single else None


class _Streamed:
    """Position targets as sensor_msgs/JointState on joint_commands."""

    def __init__(self, topic: str, typestore: Typestore, ros1: bool, others: Sequence[str]) -> None:
        self.topics = {(topic, JOINT_STATE)}
        self.dropped: Counter[str] = Counter()
        self.notes = [f"commands: {topic}; not used: {', '.join(others)}"] if others else []
        self._topic = topic
        self._reader = JointStateReader(typestore, ros1=ros1, dropped=self.dropped)

    def feed_of(self, topic: str) -> Feed:
        return self._reader

    def commands(self, measured: Stream) -> Commands | None:
        stream = assemble(self._reader.finish(), self.dropped)
        if stream is None:
            self.notes.append(f"{self._topic}: no message can be used ({_counts(self.dropped)})")
            return None
        if stream.by_receive_time:
            self.notes.append(f"{self._topic}: no header stamps, so the times are those of receiving")
        return Commands(stream.stamp_ns, stream.joints, stream.position, "hold")


class _Controllers:
    """Position targets as std_msgs/Float64, a topic for each joint; they have no stamp but that of receiving."""

    def __init__(self, topics: set[tuple[str, str]], ros1: bool) -> None:
        self.topics = topics
        self.dropped: Counter[str] = Counter()
        self.notes = ["commands of single controllers carry no stamps, so their times are those of receiving"]
        self._at = 0 if ros1 else 4
        self._received: dict[str, list[tuple[int, int, float]]] = {}
        self._order = 0

    def feed_of(self, topic: str) -> Feed:
        received = self._received.setdefault(topic, [])

        def feed(raw: bytes, received_ns: int) -> None:
            little = self._at == 0 or raw[1:2] == b"\x01"
            try:
                (value,) = struct.unpack_from("<d" if little else ">d", raw, self._at)
            except struct.error:
                self.dropped["undecodable"] += 1
                return
            received.append((received_ns, self._order, value))
            self._order += 1

        return feed

    def commands(self, measured: Stream) -> Commands | None:
        parts: dict[str, Rows] = {}
        for topic, received in sorted(self._received.items()):
            name = joint_of_topic(topic, measured.joints)
            assert name is not None
            rows = parts.setdefault(name, Rows((name,)))
            for received_ns, order, value in received:
                rows.add(received_ns, received_ns, order, (value,))
        stream = assemble(list(parts.values()), self.dropped)
        return None if stream is None else Commands(stream.stamp_ns, stream.joints, stream.position, "hold")


class _Trajectories:
    """Targets as trajectory_msgs/JointTrajectory."""

    def __init__(self, topics: set[tuple[str, str]], typestore: Typestore, ros1: bool) -> None:
        self.topics = topics
        self.dropped: Counter[str] = Counter()
        self.notes: list[str] = []
        self._decode = typestore.deserialize_ros1 if ros1 else typestore.deserialize_cdr
        self._messages: list[TrajectoryMessage] = []
        self._unstamped = 0

    def feed_of(self, topic: str) -> Feed:
        return self._feed

    def _feed(self, raw: bytes, received_ns: int) -> None:
        try:
            message: Any = self._decode(raw, JOINT_TRAJECTORY)
            names = tuple(message.joint_names)
            stamp_ns = _nanoseconds(message.header.stamp)
            times = [_nanoseconds(point.time_from_start) for point in message.points]
            targets = [np.array(point.positions, dtype=float) for point in message.points]
        except Exception:  # foreign bytes break a decoder in every way there is
            self.dropped["undecodable"] += 1
            return
        if any(len(target) != len(names) for target in targets):
            self.dropped["wrong_length"] += 1
            return
        self._unstamped += stamp_ns <= 0
        start_ns = stamp_ns if stamp_ns > 0 else received_ns
        position = np.array(targets).reshape(len(targets), len(names))
        self._messages.append(TrajectoryMessage(start_ns, names, np.array(times, dtype=np.int64), position))

    def commands(self, measured: Stream) -> Commands | None:
        if self._unstamped:
            self.notes.append(f"{self._unstamped} trajectories start when they were received: their stamp is empty")
        return expand_trajectories(self._messages, lambda name, at: _measured_at(measured, name, at), self.dropped)


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * SECOND_NS + int(time.nanosec)


def _measured_at(measured: Stream, name: str, stamp_ns: int) -> float | None:
    """Where a joint was measured nearest to a moment; None if never within a second of it."""
    if name not in measured.joints:
        return None
    values = measured.position[:, measured.joints.index(name)]
    rows = np.flatnonzero(np.isfinite(values))
    if not rows.size:
        return None
    after = int(np.searchsorted(measured.stamp_ns[rows], stamp_ns))
    near = min(
        (rows[i] for i in (after - 1, after) if 0 <= i < rows.size), key=lambda r: abs(measured.stamp_ns[r] - stamp_ns)
    )
    return float(values[near]) if abs(int(measured.stamp_ns[near]) - stamp_ns) <= _FAR_NS else None
