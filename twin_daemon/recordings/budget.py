"""How much work a recording may make: a few packed bytes can stand for more messages than anybody waits for.

The budget is that of whoever reads (a context variable), because the readers of rosbags cannot be given one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from twin_daemon.errors import BadInput

MOST_MESSAGES = 20_000_000
"""Of a recording, or lines of a file: five hours at 1 kHz, more than fits into memory."""
MOST_BLANK = 1000
"""Lines without anything, beside as many more as there are others."""
BASE_S, PER_MIB_S = 20.0, 2.0
"""Processor time of one reading, and more for each MiB of the file: ten minutes at 1 kHz take half a minute at most."""
_TODO = "Cut it into parts, or look at it with a tool you trust"


class Budget:
    """What the reading of one recording of so many bytes may still take, in processor time of this thread."""

    def __init__(self, size_bytes: int) -> None:
        self._limit_s = BASE_S + PER_MIB_S * size_bytes / 2**20
        self._begin_s = time.thread_time()
        self._size_bytes = size_bytes
        self._messages = 0

    def spend(self, messages: int) -> None:
        """Counts messages, or lines. Raises BadInput where the budget is used up; call it about every thousand."""
        self._messages += messages
        if self._messages > MOST_MESSAGES:
            raise BadInput(f"it has more than {MOST_MESSAGES} messages", todo=_TODO)
        if time.thread_time() - self._begin_s > self._limit_s:
            raise BadInput(
                f"reading these {self._size_bytes} bytes takes more than {self._limit_s:.0f} s of the processor, and "
                f"{self._messages} messages are not the end",
                todo=_TODO,
            )


_NOW: ContextVar[Budget | None] = ContextVar("budget", default=None)


@contextmanager
def reading(size_bytes: int) -> Iterator[None]:
    """What is read inside has the budget of a recording of so many bytes."""
    token = _NOW.set(Budget(size_bytes))
    try:
        yield
    finally:
        _NOW.reset(token)


def spend(messages: int) -> None:
    """Counts against the budget of what is being read, if anything is."""
    budget = _NOW.get()
    if budget is not None:
        budget.spend(messages)
