"""A journal: one JSON object a line, chained by hashes, only ever appended to.

`prev` of a line is the SHA-256 of the line before it (64 zeros for the first), and `sum`, which ends a line, that of
all before it: what is changed, removed or moved shows. A writer that is killed leaves whole lines, or one that is torn
at the very end; the next line then says how long it was (`torn_before`). Nothing shows that lines were cut off the end:
keep the hash of the last line elsewhere for that. Lines of earlier releases have no such `sum`, or neither; they are
read as they are, and a journal of them is gone on with.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from twin_daemon.files import sync_folder

_START = "0" * 64
_SUM = b', "sum": "'
_ENDS_IN_SUM = re.compile(rb', "sum": "[0-9a-f]{64}"}$')
_OWN = ("prev", "sum", "torn_before")
_TAIL_BYTES = 1 << 16


@dataclass
class Line:
    """One line as it stands in the file, `number` from 1. `torn`: a writer died while it wrote it. `follows`: whether
    its `prev` is the hash of the line before; True where it has none. `after_sums`: earlier lines have a sum, so that
    this one must have one."""

    number: int
    raw: bytes
    torn: bool = False
    follows: bool = True
    after_sums: bool = False

    @cached_property
    def content(self) -> dict[str, Any] | None:
        """The object with all that the journal added; None where this is none."""
        try:
            content = json.loads(self.raw)
        except (ValueError, RecursionError):
            return None
        return content if isinstance(content, dict) else None

    @cached_property
    def entry(self) -> dict[str, Any] | None:
        """What was appended; None where the line is not the one that was written, as far as that can be told."""
        content = self.content
        if content is None or self.torn or not self._sum_holds():
            return None
        return {key: value for key, value in content.items() if key not in _OWN} if "prev" in content else content

    @property
    def hash(self) -> str:
        return hashlib.sha256(self.raw).hexdigest()

    @property
    def has_sum(self) -> bool:
        return _ENDS_IN_SUM.search(self.raw) is not None

    def _sum_holds(self) -> bool:
        if not self.has_sum:
            return not self.after_sums
        body, _, rest = self.raw.rpartition(_SUM)
        return rest == hashlib.sha256(body).hexdigest().encode() + b'"}'


class Journal:
    """Appends to one file. Its lines are with the operating system when `append` returns, and on disk after `sync`.

    One writer at a time; whoever shares a file takes care of that. Raises OSError where it cannot be opened.
    """

    def __init__(self, path: Path, mode: int = 0o644) -> None:
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, mode)
        self.last, self._torn = _end(self._file)
        """The last whole line (its number is not known: 0); None where there is none."""
        self._prev = _START if self.last is None else self.last.hash
        if not os.fstat(self._file).st_size:
            sync_folder(path.parent)

    def append(self, entry: Mapping[str, Any], durable: bool = False) -> int:
        """Adds one entry and returns the size before it, in bytes. Where that fails the file is as it was: OSError."""
        line = _line(entry, self._prev, self._torn)
        data = (b"\n" if self._torn else b"") + line + b"\n"
        size = os.fstat(self._file).st_size
        try:
            if os.write(self._file, data) < len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            if durable:
                os.fsync(self._file)
        except OSError:
            os.ftruncate(self._file, size)
            raise
        self._prev, self._torn = hashlib.sha256(line).hexdigest(), 0
        return size

    def sync(self) -> None:
        """Makes what was appended survive a loss of power."""
        os.fsync(self._file)

    def close(self) -> None:
        os.close(self._file)

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def lines(path: Path) -> Iterator[Line]:
    """Every line from the beginning, torn ones too. Raises OSError."""
    prev, held, sums = _START, None, False
    for number, (raw, ended) in enumerate(_raw_lines(path), start=1):
        line = Line(number, raw, torn=not ended, after_sums=sums)
        sums = sums or line.has_sum
        if held is not None:
            is_torn = line.content is not None and line.content.get("torn_before") == len(held.raw)
            judged, prev = _judged(held, prev, is_torn)
            yield judged
        held = line
    if held is not None:
        yield _judged(held, prev, held.torn)[0]


def last_line(path: Path) -> Line | None:
    """The last line (numbered 0), of which only the end of the file is read; None where there is none or it is torn."""
    try:
        with path.open("rb") as file:
            line, torn = _end(file.fileno())
    except FileNotFoundError:
        return None
    return None if torn else line


def chained(entries: Iterable[Mapping[str, Any]]) -> bytes:
    """The journal that holds exactly these entries."""
    content, prev = b"", _START
    for entry in entries:
        line = _line(entry, prev, 0)
        content, prev = content + line + b"\n", hashlib.sha256(line).hexdigest()
    return content


def _line(entry: Mapping[str, Any], prev: str, torn: int) -> bytes:
    torn_before = {"torn_before": torn} if torn else {}
    body = json.dumps({**entry, **torn_before, "prev": prev}, allow_nan=False).encode()[:-1]
    return body + _SUM + hashlib.sha256(body).hexdigest().encode() + b'"}'


def _judged(line: Line, prev: str, torn: bool) -> tuple[Line, str]:
    """The line with what its neighbours say of it, and the hash that the next one must have."""
    line.torn = torn
    if torn:
        return line, prev
    said = None if line.content is None else line.content.get("prev")
    line.follows = said is None or said == prev
    return line, line.hash


def _raw_lines(path: Path) -> Iterator[tuple[bytes, bool]]:
    """Each line without its end, and whether it has one."""
    with path.open("rb") as file:
        for line in file:
            yield line.removesuffix(b"\n"), line.endswith(b"\n")


def _end(file: int) -> tuple[Line | None, int]:
    """The last whole line, and the bytes of a torn one behind it."""
    size = os.fstat(file).st_size
    back = _TAIL_BYTES
    while True:
        start = max(0, size - back)
        tail = os.pread(file, size - start, start)
        whole, newline, torn = tail.rpartition(b"\n")
        _, another, line = whole.rpartition(b"\n")
        if start == 0 or (newline and another):
            return (Line(0, line) if newline else None), len(torn)
        back *= 4
