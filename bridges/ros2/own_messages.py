"""What this bridge has published on command topics, which it hears there as well: its own are told from others'.

rclpy does not say which publisher a message is from. It says when it was written, though, on the writer's clock: own
messages are written while `publish` runs, and each of them comes back once. Knows nothing of ROS.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import defaultdict, deque
from collections.abc import Hashable, Iterator
from dataclasses import dataclass

_REMEMBERED = 4096
_AGE_NS = 2_000_000_000  # a message is back within this, also on a loaded machine
_ROUNDED_NS = 10_000  # some transports tell times in microseconds


@dataclass(slots=True)
class _Published:
    content: Hashable
    begun_ns: int
    done_ns: int | None = None  # None while it is being published


class OwnMessages:
    """By topic, in order. Safe in several threads: a message may be heard before `publish` returns."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._published: dict[str, deque[_Published]] = defaultdict(lambda: deque(maxlen=_REMEMBERED))

    @contextlib.contextmanager
    def publishing(self, topic: str, content: Hashable) -> Iterator[None]:
        """Around the call that publishes `content` on the topic, by its full name."""
        one = _Published(content, time.time_ns())
        with self._lock:
            before = self._published[topic]
            while before and one.begun_ns - before[0].begun_ns > _AGE_NS:
                before.popleft()
            before.append(one)
        try:
            yield
        finally:
            one.done_ns = time.time_ns()

    def take(self, topic: str, content: Hashable, written_ns: int | None) -> bool:
        """Whether this is one of them, which counts only once. `written_ns` is when its writer wrote it, since 1970, as
        the transport says; None or 0 where it does not, and its content alone decides."""
        with self._lock:
            published = self._published[topic]
            for number, one in enumerate(published):
                if one.content == content and _fits(one, written_ns):
                    for _ in range(number + 1):  # in order: what was published before it will not come any more
                        published.popleft()
                    return True
        return False


def _fits(one: _Published, written_ns: int | None) -> bool:
    if not written_ns:
        return True
    done_ns = time.time_ns() if one.done_ns is None else one.done_ns
    return one.begun_ns - _ROUNDED_NS <= written_ns <= done_ns + _ROUNDED_NS
