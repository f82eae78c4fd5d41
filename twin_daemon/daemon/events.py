"""Things that happened, for people and programs: few, plain, bounded."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Event:
    """One thing that happened. `kind` is for programs, `text` for people."""

    stamp_ns: int
    kind: str
    text: str

    def as_json(self) -> dict[str, Any]:
        return {"schema": 1, "stamp_ns": self.stamp_ns, "kind": self.kind, "text": self.text}


class EventLog:
    """The last events, and those that nobody has taken to the outside yet. Both are bounded."""

    def __init__(self, kept: int = 100) -> None:
        self._recent: deque[Event] = deque(maxlen=kept)
        self._fresh: deque[Event] = deque(maxlen=kept)

    def add(self, stamp_ns: int, kind: str, text: str) -> None:
        event = Event(stamp_ns, kind, text)
        self._recent.append(event)
        self._fresh.append(event)

    def take(self) -> list[Event]:
        """The events since the last call, oldest first."""
        taken = list(self._fresh)
        self._fresh.clear()
        return taken

    def recent(self, count: int = 20) -> list[Event]:
        return list(self._recent)[-count:]
