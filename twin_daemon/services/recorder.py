"""What the hand says and is told, and what the twin makes of it, written down as it arrives."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from types import TracebackType

from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.errors import BadInput
from twin_daemon.hand import HandDescription
from twin_daemon.recordings.mcap_file import StreamWriter
from twin_daemon.services.inbox import Inbox
from twin_daemon.services.residual_message import residual_sample
from twin_daemon.services.stop import Stoppable

# The topic in the file by the name of the stream's key. What the twin makes stands below twin/, where no loader of
# recordings takes it for something measured.
TOPICS = {
    "joint_states": "joint_states",
    "joint_commands": "joint_commands",
    "twin_joint_states": "twin/joint_states",
    "residual": "twin/residual",
}
_FLUSH_S = 1.0  # what a killed recorder loses at most

Listen = Callable[[str, Callable[[bytes], None]], Callable[[], None]]
"""Begins to hear a key: each payload goes to the function given. What comes back ends it."""


class Recorded:
    """How many messages of each topic were written, how many could not be, and when."""

    def __init__(self) -> None:
        self.messages: Counter[str] = Counter(dict.fromkeys(TOPICS.values(), 0))
        self.refused: Counter[str] = Counter()
        self.dropped = 0
        self.first_s: dict[str, float] = {}  # by topic, monotonic
        self.last_s: dict[str, float] = {}

    @property
    def joint_states(self) -> int:
        return self.messages["joint_states"]

    @property
    def joint_commands(self) -> int:
        return self.messages["joint_commands"]

    @property
    def duration_s(self) -> float:
        """From the first message to the last one, of whatever topic."""
        return max(self.last_s.values()) - min(self.first_s.values()) if self.first_s else 0.0

    def rate_hz(self, topic: str) -> float | None:
        """Messages per second while the topic spoke; None below two messages."""
        span_s = self.last_s.get(topic, 0.0) - self.first_s.get(topic, 0.0)
        return (self.messages[topic] - 1) / span_s if span_s > 0.0 else None

    def add(self, topic: str, arrival_s: float) -> None:
        self.messages[topic] += 1
        self.first_s.setdefault(topic, arrival_s)
        self.last_s[topic] = arrival_s


class Recorder:
    """Writes all streams of a hand and its twin into one MCAP file while it is open. `work` has to be called to write.

    The file has its name only when the block has ended without an error; until then, and after an error, it is the
    .part beside it (see StreamWriter). Without a single message there is no file.
    """

    def __init__(self, listen: Listen, description: HandDescription, path: Path) -> None:
        self.done = Recorded()
        self._inbox = Inbox(size=8192)
        self._file = StreamWriter(path)
        self._channels = add_channels(self._file, description)
        self._wall_ns = wall_offset_ns()
        self._next_flush_s = 0.0
        try:
            self._ends = [listen(description.key(stream), partial(self._inbox.put, stream)) for stream in TOPICS]
        except BaseException:
            self._file.discard()
            raise

    def __enter__(self) -> Recorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for end in self._ends:
            end()
        if kind is not None:
            self._file.abandon()
            return
        try:
            self.work(0.0)
            self.done.dropped = self._inbox.dropped
            with self._disk():
                self._file.finish() if self._file.messages else self._file.discard()
        except BaseException:
            self._file.abandon()
            raise

    @property
    def bytes(self) -> int:
        """Size of the file so far."""
        return self._file.bytes

    def work(self, seconds: float, stop: Stoppable | None = None) -> None:
        """Writes what arrives during `seconds`, or until `stop` is set. Raises BadInput when the disk does not."""
        end_s = time.monotonic() + seconds
        while True:
            with self._disk():
                for stream, payload, arrival_s, _ in self._inbox.take(min(0.1, max(end_s - time.monotonic(), 0.0))):
                    self._write(stream, payload, arrival_s)
                now_s = time.monotonic()
                if now_s >= self._next_flush_s:
                    self._next_flush_s = now_s + _FLUSH_S
                    self._file.flush()
            self.done.dropped = self._inbox.dropped
            if now_s >= end_s or (stop is not None and stop.is_set()):
                return

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """What a disk refuses, as an error that says where the rest of the recording is."""
        try:
            yield
        except OSError as error:
            raise BadInput(
                f"cannot be written ({error.strerror})",
                where=self._file.part,
                todo=f"Free space, then 'twin record --recover {self._file.part}' brings back what is in it",
            ) from None

    def _write(self, stream: str, payload: bytes, arrival_s: float) -> None:
        try:
            stamp_ns, message = as_joint_state(stream, payload)
        except MalformedPayload:
            self.done.refused[TOPICS[stream]] += 1
            return
        self._file.write(self._channels[stream], self._wall_ns + round(arrival_s * 1e9), stamp_ns, message)
        self.done.add(TOPICS[stream], arrival_s)


def wall_offset_ns() -> int:
    """What turns a monotonic time into one of the wall clock. Taken once a file, so that no clock step tears it."""
    return time.time_ns() - time.monotonic_ns()


def add_channels(file: StreamWriter, description: HandDescription) -> dict[str, int]:
    """The channel of each stream. All are declared, so that a reader sees which of them were silent."""
    return {
        stream: file.add_channel(topic, hand=description.name, key=description.key(stream))
        for stream, topic in TOPICS.items()
    }


def as_joint_state(stream: str, payload: bytes) -> tuple[int, bytes]:
    """Stamp and CDR bytes of a message, as they came or, for the residual, made from the JSON.

    Raises MalformedPayload for what no reader could use.
    """
    if stream == "residual":
        sample = residual_sample(payload)
        return sample.stamp_ns, cdr.encode(sample)
    sample = cdr.decode(payload)
    if not sample.names or len(sample.position) != len(sample.names):
        raise MalformedPayload("length_mismatch", f"{len(sample.position)} positions for {len(sample.names)} joints")
    return sample.stamp_ns, payload
