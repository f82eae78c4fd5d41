"""One way to stop: by SIGTERM, SIGINT or from the program, and every wait ends at once."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import threading
from types import FrameType
from typing import Protocol


class Stoppable(Protocol):
    """What a waiting loop needs; threading.Event has it too."""

    def is_set(self) -> bool: ...

    def wait(self, timeout: float) -> bool: ...


class StopSignal:
    """Like an Event, but safe to set from a signal handler: an Event's lock may be held by the interrupted code."""

    def __init__(self) -> None:
        self._set = False
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)

    def set(self, *_: object) -> None:
        self._set = True
        with contextlib.suppress(OSError):  # full or closed: whoever waits is awake anyway
            os.write(self._write, b"x")

    def is_set(self) -> bool:
        return self._set

    def wait(self, timeout: float) -> bool:
        if not self._set:
            select.select([self._read], [], [], max(timeout, 0.0))
        return self._set

    def close(self) -> None:
        os.close(self._read)
        os.close(self._write)


class Hangup:
    """Whether SIGHUP came since it was last asked. Where it is not wanted, the signal keeps its usual meaning."""

    def __init__(self, wanted: bool) -> None:
        self._came = False
        self._before = signal.signal(signal.SIGHUP, self._handle) if wanted else None

    def _handle(self, _number: int, _frame: FrameType | None) -> None:
        self._came = True

    def came(self) -> bool:
        came, self._came = self._came, False
        return came

    def close(self) -> None:
        if self._before is not None:
            signal.signal(signal.SIGHUP, self._before)


class on_termination:
    """Gives a StopSignal that SIGTERM and SIGINT set; the handlers from before are back afterwards."""

    def __enter__(self) -> StopSignal:
        self._stop = StopSignal()

        def handle(_number: int, _frame: FrameType | None) -> None:
            self._stop.set()

        self._before = {number: signal.signal(number, handle) for number in (signal.SIGTERM, signal.SIGINT)}
        return self._stop

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._stop.close()


def leave(code: int) -> int:
    """The exit code, for a command that has put away all that it keeps; or the end, where a thread still computes.

    A roll-out hears of no signal, and the interpreter would wait for it: a service told to stop would be killed.
    """
    others = [thread for thread in threading.enumerate() if thread is not threading.current_thread()]
    if any(not thread.daemon for thread in others):
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code
