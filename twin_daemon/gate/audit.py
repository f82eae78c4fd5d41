"""Who asked what, when, what was answered and why: one line each, chained by hashes, only ever appended to.

A line is JSON whose `prev` is the SHA-256 of the line before, so that a line which is changed, removed or moved
breaks the chain there. A writer that is killed leaves whole lines, or one that is torn at the very end; the next line
then says so. A chain shows that nothing was changed within it; it cannot show that nothing was cut off its end: keep
the hash of the last line elsewhere for that.
"""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from twin_daemon.errors import BadInput
from twin_daemon.files import sync_folder

_START = "0" * 64
_TAIL_BYTES = 1 << 16


class AuditLog:
    """Appends to one file. The lines are with the operating system when `write` returns, and on disk after `sync`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        path.parent.mkdir(parents=True, exist_ok=True)
        is_new = not path.exists()
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
        if is_new:
            sync_folder(path.parent)
        self._prev, self._number, self._torn = self._end()

    def write(self, stamp_ns: int, entry: dict[str, Any]) -> None:
        """Appends one entry. Raises OSError where it cannot be written; the file then holds none of it, or a torn
        line that the next entry names."""
        with self._lock:
            number = self._number + 1
            whole = {"number": number, "stamp_ns": stamp_ns, **entry, "prev": self._prev}
            if self._torn:
                whole["torn_before"] = self._torn
            line = json.dumps(whole, allow_nan=False).encode()
            data = (b"\n" if self._torn else b"") + line + b"\n"
            size = os.fstat(self._file).st_size
            try:
                written = os.write(self._file, data)
                if written < len(data):
                    raise OSError(28, "No space left on device")
            except OSError:
                os.ftruncate(self._file, size)
                raise
            self._prev, self._number, self._torn = hashlib.sha256(line).hexdigest(), number, 0

    def sync(self) -> None:
        """Makes what was written survive a loss of power."""
        os.fsync(self._file)

    def close(self) -> None:
        with self._lock:
            self.sync()
            os.close(self._file)

    def _end(self) -> tuple[str, int, int]:
        """Hash and number of the last whole line, and the bytes of a torn one behind it."""
        size = os.fstat(self._file).st_size
        back = _TAIL_BYTES
        while True:
            start = max(0, size - back)
            tail = os.pread(self._file, size - start, start)
            whole, newline, torn = tail.rpartition(b"\n")
            line = whole.rpartition(b"\n")[2]
            if start == 0 or (newline and b"\n" in whole):
                break
            back *= 2
        if not newline or not line:
            return _START, 0, len(torn)
        try:
            number = int(json.loads(line)["number"])
        except (ValueError, KeyError, TypeError):
            raise BadInput(
                "the last line of the audit log is no entry",
                where=self._path,
                todo="Look with 'twin audit verify'; move the file away to begin a new one",
            ) from None
        return hashlib.sha256(line).hexdigest(), number, len(torn)


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
    prev, entries, torn = _START, 0, 0
    broken: list[Broken] = []
    for place, (line, is_torn) in enumerate(_judged(path), start=1):
        if is_torn:
            torn += 1
            continue
        entry = _entry(line)
        if entry is None:
            broken.append(Broken(place, "this is no entry"))
            continue
        if entry.get("prev") != prev:
            broken.append(Broken(place, "the line before it was changed, removed or moved"))
        entries += 1
        number = entry.get("number")
        if number != entries:
            broken.append(Broken(place, f"it bears number {number} and should bear {entries}"))
            entries = number if isinstance(number, int) else entries
        prev = hashlib.sha256(line).hexdigest()
    return Verified(entries, prev, torn, tuple(broken))


def _judged(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Each line, and whether a writer died while it wrote it: the last one without its end, or one that the next
    entry calls so."""
    held: bytes | None = None
    whole = True
    for line, ended in _lines(path):
        if held is not None:
            entry = _entry(line)
            yield held, entry is not None and entry.get("torn_before") == len(held)
        held, whole = line, ended
    if held is not None:
        yield held, not whole


def entries_of(path: Path) -> Iterator[dict[str, Any]]:
    """The readable entries of a log, oldest first."""
    for line, is_torn in _judged(path):
        entry = _entry(line)
        if not is_torn and entry is not None:
            yield entry


def _lines(path: Path) -> Iterator[tuple[bytes, bool]]:
    try:
        with path.open("rb") as file:
            for line in file:
                yield line.removesuffix(b"\n"), line.endswith(b"\n")
    except OSError as error:
        raise BadInput(f"cannot be read: {error.strerror}", where=path, todo="'twin run' begins one") from None


def _entry(line: bytes) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None
