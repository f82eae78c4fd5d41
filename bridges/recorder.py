"""What the hand says and is told, written down as it arrives."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
import zenoh

from bridges import cdr
from bridges.inbox import Inbox
from bridges.stop import Stoppable
from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.hand import HandDescription
from twin_daemon.recordings.writer import McapWriter

STREAMS = ("joint_states", "joint_commands")


@dataclass
class Recorded:
    """How many messages of each stream were written, and how many could not be."""

    joint_states: int = 0
    joint_commands: int = 0
    refused: int = 0
    dropped: int = 0


class Recorder:
    """Writes both streams of a hand into one MCAP file while it is open. `work` has to be called to write."""

    def __init__(self, session: zenoh.Session, description: HandDescription, path: Path) -> None:
        self.done = Recorded()
        self._inbox = Inbox(size=8192)
        self._writer = McapWriter(path)
        self._subscribers = [
            session.declare_subscriber(
                description.key(stream),
                lambda sample, stream=stream: self._inbox.put(stream, sample.payload.to_bytes()),
            )
            for stream in STREAMS
        ]

    def __enter__(self) -> Recorder:
        self._writer.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self.work(0.0)
        self.done.dropped = self._inbox.dropped
        self._writer.__exit__(kind, error, trace)

    def work(self, seconds: float, stop: Stoppable | None = None) -> None:
        """Writes what arrives during `seconds`, or until `stop` is set."""
        end_s = time.monotonic() + seconds
        while True:
            for stream, payload, _ in self._inbox.take(min(0.1, max(end_s - time.monotonic(), 0.0))):
                self._write(stream, payload)
            if time.monotonic() >= end_s or (stop is not None and stop.is_set()):
                return

    def _write(self, stream: str, payload: bytes) -> None:
        try:
            sample = cdr.decode(payload)
        except MalformedPayload:
            self.done.refused += 1
            return
        if not sample.names or len(sample.position) != len(sample.names):
            self.done.refused += 1
            return
        if stream == "joint_commands":
            self._writer.joint_commands(sample.stamp_ns, sample.names, sample.position)
            self.done.joint_commands += 1
        else:
            velocity, effort = (_whole(values, sample) for values in (sample.velocity, sample.effort))
            self._writer.joint_states(sample.stamp_ns, sample.names, sample.position, velocity, effort)
            self.done.joint_states += 1


def _whole(values: np.ndarray, sample: JointSample) -> np.ndarray | None:
    return values if len(values) == len(sample.names) else None
