"""Who asked what, when, what was answered and why: a journal of numbered entries."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin_daemon.errors import BadInput
from twin_daemon.journal import Journal, Line, lines

_NOTHING = "0" * 64  # the hash of the last line where there is none


class AuditLog:
    """Appends to one file, from several threads. The entries are on disk after `sync`."""

    def __init__(self, path: Path) -> None:
        self._lock = threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._journal = Journal(path, mode=0o600)
        self._number = _number_of(self._journal.last, path)

    def write(self, stamp_ns: int, entry: dict[str, Any]) -> None:
        """Appends one entry. Raises OSError where it cannot be written; the file then holds none of it, or a torn
        line that the next entry names."""
        with self._lock:
            self._journal.append({"number": self._number + 1, "stamp_ns": stamp_ns, **entry})
            self._number += 1

    def sync(self) -> None:
        """Makes what was written survive a loss of power."""
        self._journal.sync()

    def close(self) -> None:
        with self._lock:
            self.sync()
            self._journal.close()


@dataclass(frozen=True)
class Broken:
    """Where a chain breaks, and how."""

    line: int
    why: str


@dataclass(frozen=True)
class Verified:
    """What a look at a whole log found. `last` is the hash of its last line."""

    entries: int
    last: str
    torn: int
    broken: tuple[Broken, ...]


def verify(path: Path) -> Verified:
    """Reads a log from its beginning. Raises BadInput where it cannot be read."""
    last, entries, torn = _NOTHING, 0, 0
    broken: list[Broken] = []
    for line in _lines(path):
        if line.torn:
            torn += 1
            continue
        entry = line.entry
        if entry is None:
            broken.append(Broken(line.number, "this is no entry, or it was changed"))
            continue
        if not line.follows:
            broken.append(Broken(line.number, "the line before it was changed, removed or moved"))
        entries += 1
        number = entry.get("number")
        if number != entries:
            broken.append(Broken(line.number, f"it bears number {number} and should bear {entries}"))
            entries = number if isinstance(number, int) else entries
        last = line.hash
    return Verified(entries, last, torn, tuple(broken))


def entries_of(path: Path) -> Iterator[dict[str, Any]]:
    """The readable entries of a log, oldest first. Raises BadInput where it cannot be read."""
    return (line.content for line in _lines(path) if line.entry is not None and line.content is not None)


def _lines(path: Path) -> Iterator[Line]:
    try:
        yield from lines(path)
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", where=path, todo="'twin run' begins one") from None


def _number_of(last: Line | None, path: Path) -> int:
    if last is None:
        return 0
    try:
        return int((last.entry or {})["number"])
    except (ValueError, KeyError, TypeError):
        raise BadInput(
            "the last line of the audit log is no entry",
            where=path,
            todo="Look with 'twin audit verify'; move the file away to begin a new one",
        ) from None
