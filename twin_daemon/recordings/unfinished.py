"""Bags whose recorder was killed: a whole copy of what is whole, to be read in their place. They are never touched.

An MCAP file is copied up to the last whole record and given an end. A database with a journal is copied with it, and
SQLite takes back in the copy what was not committed. Whoever reads is told what is missing.
"""

from __future__ import annotations

import shutil
import sqlite3
import struct
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from twin_daemon.errors import BadInput
from twin_daemon.recordings.mcap_file import CHUNK, DATA_END, FOOTER, HEADER, MAGIC, MESSAGE, RECORD_HEAD

_JOURNALS = ("-journal", "-wal")
_PIECE_BYTES = 1 << 20
_KILLED = "its recorder was killed, or still writes"


@dataclass(frozen=True)
class Readable:
    """A file that can be read as a whole bag, and what to say of it; None where it was whole already."""

    path: Path
    note: str | None = None


@contextmanager
def readable(path: Path) -> Iterator[Readable]:
    """A storage file of a ROS 2 bag, or a whole copy of what of it is whole. Raises BadInput where nothing is."""
    with ExitStack() as stack:
        journals = [path.with_name(path.name + end) for end in _JOURNALS]
        left = [journal for journal in journals if journal.is_file() and journal.stat().st_size]
        unfinished = path.suffix == ".mcap" and not _has_end(path)
        if not left and not unfinished:
            yield Readable(path)
            return
        copy = Path(stack.enter_context(scratch())) / path.name
        yield Readable(copy, _completed(path, copy) if unfinished else _committed(path, copy, left))


def scratch() -> tempfile.TemporaryDirectory[str]:
    """A folder for a whole copy, gone with the block."""
    return tempfile.TemporaryDirectory(prefix="twin-unfinished-")


def left_out(name: str, bytes_: int) -> str:
    """What people are told of the end of a file."""
    return f"{name}: {_KILLED}; its last {bytes_} bytes are no whole piece and were left out"


def nothing_whole(path: Path) -> BadInput:
    """Where a recorder was killed before its first piece."""
    return BadInput(f"no whole piece is in it: {_KILLED}", where=path, todo="Record for longer, or stop the recorder")


def copy_bytes(source: BinaryIO, target: BinaryIO, count: int) -> None:
    """Copies so many bytes in pieces."""
    while count > 0 and (piece := source.read(min(count, _PIECE_BYTES))):
        target.write(piece)
        count -= len(piece)


# -- MCAP --------------------------------------------------------------------------------------------------


def _has_end(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(0, size - len(MAGIC)))
        return size > 2 * len(MAGIC) and file.read() == MAGIC


def _completed(path: Path, copy: Path) -> str:
    """Copies the data of an MCAP file up to where they are whole, and ends them without a summary."""
    with path.open("rb") as file, copy.open("wb") as target:
        size = file.seek(0, 2)
        whole, pieces = _whole_records(file, size)
        if not pieces:
            raise nothing_whole(path)
        file.seek(0)
        copy_bytes(file, target, whole)
        target.write(RECORD_HEAD.pack(DATA_END, 4) + bytes(4))
        target.write(RECORD_HEAD.pack(FOOTER, 20) + bytes(20) + MAGIC)
    return left_out(path.name, size - whole)


def _whole_records(file: BinaryIO, size: int) -> tuple[int, int]:
    """(where the last whole record of the data ends, how many chunks and single messages there are)."""
    at, pieces = len(MAGIC), 0
    while at + RECORD_HEAD.size <= size:
        file.seek(at)
        kind, length = RECORD_HEAD.unpack(file.read(RECORD_HEAD.size))
        end = at + RECORD_HEAD.size + length
        # a kind of 0 does not exist: blocks that a loss of power left empty
        if kind in (0, DATA_END, FOOTER) or end > size or (at == len(MAGIC)) != (kind == HEADER):
            break
        pieces += kind in (CHUNK, MESSAGE)
        at = end
    return at, pieces


# -- SQLite ------------------------------------------------------------------------------------------------


def _committed(path: Path, copy: Path, journals: list[Path]) -> str:
    """Copies a database with its journals, and lets SQLite finish or take back in the copy what they hold."""
    for source in (path, *journals):
        shutil.copyfile(source, copy.with_name(source.name))
    _require_plain_header(path)
    try:
        with closing(sqlite3.connect(copy)) as database:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA wal_checkpoint(TRUNCATE)")
            database.execute("PRAGMA journal_mode = DELETE")
            database.execute("SELECT count(*) FROM sqlite_master").fetchone()
    except sqlite3.DatabaseError as error:
        raise BadInput(
            f"its journal does not fit to it ({error})", where=path, todo="Copy the database with its journal again"
        ) from None
    return f"{path.name}: {_KILLED}; what it had not committed was left out"


def _require_plain_header(path: Path) -> None:
    with path.open("rb") as file:
        head = file.read(100)
    if len(head) < 100 or struct.unpack_from(">H", head, 16)[0] == 0:
        raise nothing_whole(path)
