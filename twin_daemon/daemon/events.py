"""Things that happened, for people and programs: few, plain, bounded, and kept over a restart."""

from __future__ import annotations

import contextlib
import logging
from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from twin_daemon.journal import Journal, lines

log = logging.getLogger("twin")

_LARGEST_BYTES = 4 * 2**20  # of a journal, before it becomes the old one
_FLOOD, _FLOOD_NS = 10, 10_000_000_000  # so many of a kind in so short a time; more are only counted


@dataclass(frozen=True)
class Event:
    """One thing that happened. `kind` is for programs, `text` for people, `data` what a program may want of it."""

    stamp_ns: int
    kind: str
    text: str
    data: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        return {"schema": 1, "stamp_ns": self.stamp_ns, "kind": self.kind, "text": self.text, **self.data}


class EventLog:
    """The last events, and those that nobody has taken to the outside yet. Both are bounded.

    With a `journal` they are appended to that file and read back from it at the start; a
    full journal becomes `journal.1`. A disk that cannot be written costs the record, never the daemon.
    """

    def __init__(self, journal: Path | None = None, kept: int = 200) -> None:
        self.counts: Counter[str] = Counter()
        self._recent: deque[dict[str, Any]] = deque(maxlen=kept)
        self._fresh: deque[Event] = deque(maxlen=kept)
        self._times: dict[str, deque[int]] = {}
        self._journal = journal
        if journal is not None:
            self._read_back(journal)

    def add(self, stamp_ns: int, kind: str, text: str, data: Mapping[str, Any] | None = None) -> None:
        """Keeps one event; one of a flood is only counted."""
        self.counts[kind] += 1
        times = self._times.setdefault(kind, deque(maxlen=_FLOOD))
        if len(times) == _FLOOD and stamp_ns - times[0] < _FLOOD_NS:
            self.counts["suppressed"] += 1
            return
        times.append(stamp_ns)
        event = Event(stamp_ns, kind, text, data or {})
        self._recent.append(event.as_json())
        self._fresh.append(event)
        self._write(event)

    def take(self) -> list[Event]:
        """The events since the last call, oldest first."""
        taken = list(self._fresh)
        self._fresh.clear()
        return taken

    def recent(self, count: int = 20) -> list[dict[str, Any]]:
        """The last events as JSON objects, oldest first, from before a restart as well."""
        return list(self._recent)[-count:]

    def _read_back(self, journal: Path) -> None:
        for path in (_older(journal), journal):
            with contextlib.suppress(OSError):
                for line in deque(lines(path), self._recent.maxlen):
                    if line.entry is not None:  # such as what a daemon wrote that was killed meanwhile
                        self._recent.append(line.entry)

    def _write(self, event: Event) -> None:
        journal = self._journal
        if journal is None:
            return
        try:
            journal.parent.mkdir(parents=True, exist_ok=True)
            if journal.exists() and journal.stat().st_size > _LARGEST_BYTES:
                journal.replace(_older(journal))
            with Journal(journal) as file:
                file.append(event.as_json())
        except OSError as error:
            self.counts["not_written"] += 1
            level = logging.WARNING if self.counts["not_written"] == 1 else logging.DEBUG
            log.log(level, "events cannot be kept in %s: %s", journal, error)


def _older(journal: Path) -> Path:
    return journal.with_name(journal.name + ".1")
