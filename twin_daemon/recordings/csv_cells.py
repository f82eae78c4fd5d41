"""Cells of CSV files that hold Python-style lists: read as what they are, never evaluated."""

from __future__ import annotations

import gzip
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from pydantic_core import from_json

from twin_daemon.errors import BadInput
from twin_daemon.recordings.budget import MOST_BLANK, spend
from twin_daemon.recordings.unpacking import most_bytes, too_much

_MAX_LINE = 4 * 1024 * 1024  # characters; a joint state has a few thousand
_EVERY = 1024
_BRACKETS = {"[]", "()"}


@contextmanager
def open_text(path: Path) -> Iterator[TextIO]:
    """A text file, packed with gzip or not, whatever it is called."""
    with path.open("rb") as raw:
        packed = raw.read(2) == b"\x1f\x8b"
        raw.seek(0)
        if packed:
            with gzip.open(raw, "rt", encoding="utf-8-sig", newline="") as text:
                yield text
        else:
            with io.TextIOWrapper(raw, encoding="utf-8-sig", newline="") as text:
                yield text


def lines(text: TextIO, path: Path) -> Iterator[str]:
    """Line by line, with an end to what is not made of lines, or packed from nearly nothing."""
    packed, read, count, blank = path.stat().st_size, 0, 0, 0
    while line := text.readline(_MAX_LINE):
        read += len(line)
        count += 1
        if line.isspace():
            blank += 1
            if blank > MOST_BLANK + count - blank:
                raise BadInput(f"{blank} of its first {count} lines are blank", where=path, todo="Remove them")
        if count % _EVERY == 0:
            spend(_EVERY)
        if read > most_bytes(packed):
            raise too_much(packed)
        if len(line) == _MAX_LINE:
            raise BadInput(f"a line has more than {_MAX_LINE} characters", where=path, todo="This is no CSV recording")
        yield line


def numbers(cell: str) -> list[float]:
    """The numbers of "[1, 2.5]" or "(1, 2.5)"; none of an empty cell. Raises ValueError."""
    inner = _inner(cell)
    if not inner:
        return []
    # Nearly always such a list is JSON too, whose parser is five times as fast and rounds alike. What JSON knows
    # besides numbers (true, false, null, NaN, Infinity, text, lists, objects) contains one of these characters.
    other = "t" in inner or "f" in inner or "n" in inner or "N" in inner or '"' in inner or "[" in inner or "{" in inner
    if not other:
        try:
            return from_json(f"[{inner}]")
        except ValueError:
            pass  # Python also reads 1. and .5 and +1
    return list(map(float, inner.split(",")))


def names(cell: str) -> tuple[str, ...]:
    """The names of "['a', 'b']", in either kind of quotes. Raises ValueError."""
    inner = _inner(cell)
    return tuple(_unquoted(part.strip()) for part in inner.split(",")) if inner else ()


def _inner(cell: str) -> str:
    cell = cell.strip()
    if not cell:
        return ""
    if cell[0] + cell[-1] not in _BRACKETS or len(cell) < 2:
        raise ValueError("a list in brackets is expected")
    return cell[1:-1].strip().removesuffix(",")


def _unquoted(part: str) -> str:
    if len(part) < 3 or part[0] != part[-1] or part[0] not in "'\"":
        raise ValueError("a name in quotes is expected")
    return part[1:-1]
