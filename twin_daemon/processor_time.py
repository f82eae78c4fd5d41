"""How much of this machine's processor work may take, and has taken."""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterator
from contextvars import ContextVar
from dataclasses import dataclass

import numpy as np


def thread_count() -> int:
    """Threads for roll-outs: TWIN_THREADS, or the cores that this process may use."""
    setting = os.environ.get("TWIN_THREADS", "")
    return int(setting) if setting.isdigit() and int(setting) > 0 else len(os.sched_getaffinity(0))


@dataclass
class _Process:
    """What a process was begun with: the processor's seconds before it, and how many others run beside it."""

    before_s: float = 0.0
    places: int = 1


_process = _Process()


def begin_on_one_core(before_s: float, places: int) -> None:
    """Says to a process that it has one core, as one of so many, and what was spent before they were begun."""
    _process.before_s, _process.places = before_s, places
    os.environ["TWIN_THREADS"] = "1"


def processor_s() -> float:
    """Seconds of the processor that this work has taken, in this process, in those before it and in those beside it.

    Those that are still running count as this one does.
    """
    spent = os.times()
    return _process.before_s + _process.places * (
        spent.user + spent.system + spent.children_user + spent.children_system
    )


class OutOfTime(Exception):
    """The time that work was given is over. What it has until then is kept by whoever gave it."""


class TimeLimit:
    """So many seconds of all of this machine's cores, from now on, or by the wall clock; None for no end.

    It counts what this process does and those that it begins: work that is sent to another one takes no limit along.
    """

    def __init__(self, seconds: float | None = None, *, wall_s: float | None = None) -> None:
        self._processor_s = np.inf if seconds is None else seconds * thread_count()
        self._wall_s = np.inf if wall_s is None else wall_s
        self._began_s, self._begun_at_s = processor_s(), time.monotonic()

    def over(self, share: float = 1.0) -> bool:
        """Whether this share of it has gone."""
        return (
            processor_s() - self._began_s > share * self._processor_s
            or time.monotonic() - self._begun_at_s > share * self._wall_s
        )

    @contextlib.contextmanager
    def enforced(self) -> Iterator[None]:
        """While this lasts, roll-outs and independent work raise OutOfTime instead of beginning when it is over."""
        token = _enforced.set(self)
        try:
            yield
        finally:
            _enforced.reset(token)

    def __reduce__(self) -> tuple[type[TimeLimit], tuple[()]]:
        return TimeLimit, ()

    def check(self) -> None:
        """Raises OutOfTime where it is over."""
        if self.over():
            raise OutOfTime


_enforced: ContextVar[TimeLimit | None] = ContextVar("enforced", default=None)


def check_time() -> None:
    """Raises OutOfTime where the limit that is enforced here is over."""
    limit = _enforced.get()
    if limit is not None:
        limit.check()
