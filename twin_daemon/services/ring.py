"""The last minutes of all streams in memory, so that what led to a surprise can be saved after it."""

from __future__ import annotations

import threading
from collections import deque
from typing import NamedTuple

# What a kept message takes in memory beside its bytes: a tuple, its numbers, the header of the bytes (measured).
OVERHEAD_BYTES = 200


class Kept(NamedTuple):
    """One message: when it arrived (monotonic), its stamp, the stream by the name of its key, its bytes."""

    arrival_s: float
    stamp_ns: int
    stream: str
    payload: bytes


class Ring:
    """Bounded by `seconds` before the newest message, and by `size_bytes` of memory; the oldest message goes first.

    The time is counted from the newest message and not from now: when the hand falls silent, what it did last stays.
    Safe for one thread that adds and others that look.
    """

    def __init__(self, seconds: float, size_bytes: int) -> None:
        self.seconds = seconds
        self.size_bytes = size_bytes
        # plain tuples: the garbage collector looks at each of 100 000 of any other kind, for 30 ms
        self._messages: deque[tuple[float, int, str, bytes]] = deque()
        self._bytes = 0
        self._full = False
        self._lock = threading.Lock()

    def add(self, stream: str, stamp_ns: int, payload: bytes, arrival_s: float) -> None:
        """Keeps one message. A few microseconds: it is called by the loop."""
        if self.seconds <= 0.0:
            return
        with self._lock:
            self._messages.append((arrival_s, stamp_ns, stream, payload))
            self._bytes += len(payload) + OVERHEAD_BYTES
            while self._messages and self._bytes > self.size_bytes:
                self._full = True
                self._forget()
            while self._messages and self._messages[0][0] < arrival_s - self.seconds:
                self._full = False
                self._forget()

    def _forget(self) -> None:
        self._bytes -= len(self._messages.popleft()[3]) + OVERHEAD_BYTES

    def messages(self) -> list[Kept]:
        """All messages in the order in which they were added."""
        with self._lock:
            kept = list(self._messages)
        return [Kept._make(message) for message in kept]

    @property
    def used_bytes(self) -> int:
        return self._bytes

    @property
    def full(self) -> bool:
        """Whether it holds less than `seconds` because its memory is used up."""
        return self._full
