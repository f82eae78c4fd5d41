"""Between the transport's threads and the loop: bounded, never blocking, the oldest message gives way."""

from __future__ import annotations

import threading
import time
from collections import deque


class Inbox:
    """Messages (stream, payload, monotonic arrival, source) in order of arrival; a source is "" where nobody asks."""

    def __init__(self, size: int = 512) -> None:
        self._messages: deque[tuple[str, bytes, float, str]] = deque(maxlen=size)
        self._ready = threading.Condition()
        self.dropped = 0

    def put(self, stream: str, payload: bytes, source: str = "") -> None:
        """Called from the transport. When the loop is too slow the oldest message is dropped and counted."""
        with self._ready:
            if len(self._messages) == self._messages.maxlen:
                self.dropped += 1
            self._messages.append((stream, payload, time.monotonic(), source))
            self._ready.notify()

    def take(self, timeout_s: float) -> list[tuple[str, bytes, float, str]]:
        """All waiting messages; waits for a first one at most `timeout_s`."""
        with self._ready:
            if not self._messages:
                self._ready.wait(timeout_s)
            taken = list(self._messages)
            self._messages.clear()
            return taken
