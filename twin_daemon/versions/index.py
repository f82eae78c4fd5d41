"""A cache of what the version folders hold, so that listing many versions reads few files. SQLite, one file a hand.

A row is believed only while its folder's files have the sizes and times that they had when they were verified, and
while the row has the sum it was written with. A cache that is missing, damaged or in the way is never an error.
"""

from __future__ import annotations

import hashlib
import logging
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

log = logging.getLogger("twin")

INDEX = "index.sqlite"
_LAYOUT = 1  # PRAGMA user_version; another number is rebuilt
_WAIT_S = 2.0
_PASSING = (
    sqlite3.SQLITE_BUSY,
    sqlite3.SQLITE_LOCKED,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_PERM,
)
_TABLE = """CREATE TABLE IF NOT EXISTS versions (
    id TEXT PRIMARY KEY,
    mark TEXT NOT NULL,      -- sizes and times of the files when they were verified
    whole INTEGER NOT NULL,  -- 0: a stub
    record BLOB NOT NULL,    -- version.json
    sum TEXT NOT NULL
) WITHOUT ROWID"""


class Row(NamedTuple):
    """One verified version: its folder's fingerprint, whether its model is there, and its record."""

    mark: str
    whole: bool
    record: bytes

    def sum(self, version_id: str) -> str:
        head = f"{version_id} {self.mark} {int(self.whole)} ".encode()
        return hashlib.sha256(head + self.record).hexdigest()


class _NotWrittenYet(Exception):
    """The file was created by a process that came no further."""


class Index:
    """The cache in one hand's folder."""

    def __init__(self, root: Path) -> None:
        self._path = root / INDEX

    def rows(self) -> dict[str, Row]:
        """Every row that is as it was written; empty where there is no usable cache."""
        if not self._path.is_file():
            return {}
        try:
            with self._open(writing=False) as connection:
                found = connection.execute("SELECT id, mark, whole, record, sum FROM versions").fetchall()
                rows = {row[0]: (Row(row[1], bool(row[2]), bytes(row[3])), row[4]) for row in found}
        except _NotWrittenYet:
            return {}
        except (sqlite3.Error, TypeError, ValueError) as error:
            self._give_up(error)
            return {}
        return {version_id: row for version_id, (row, said) in rows.items() if row.sum(version_id) == said}

    def write(self, rows: dict[str, Row], *, known: set[str]) -> bool:
        """Add or replace rows and forget every id that is not in `known`. False where it cannot be written."""
        for _ in range(2):
            try:
                with self._open(writing=True) as connection, connection:
                    connection.execute(_TABLE)
                    stored = {row[0] for row in connection.execute("SELECT id FROM versions")}
                    connection.executemany("DELETE FROM versions WHERE id = ?", [(gone,) for gone in stored - known])
                    connection.executemany(
                        "INSERT OR REPLACE INTO versions VALUES (?, ?, ?, ?, ?)",
                        [(key, row.mark, int(row.whole), row.record, row.sum(key)) for key, row in rows.items()],
                    )
                return True
            except (sqlite3.Error, ValueError) as error:
                if not self._give_up(error):
                    return False
        return False

    def sound(self) -> bool:
        """Whether SQLite finds nothing wrong with the file."""
        if not self._path.is_file():
            return False
        try:
            with self._open(writing=False) as connection:
                return connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        except (sqlite3.Error, ValueError, _NotWrittenYet):
            return False

    def drop(self) -> bool:
        """Remove the cache, to be built again or to make room on a full disk. False where that cannot be done."""
        try:
            for path in self._path.parent.glob(f"{INDEX}*"):
                path.unlink(missing_ok=True)
        except OSError:
            return False
        return True

    @contextmanager
    def _open(self, *, writing: bool) -> Iterator[sqlite3.Connection]:
        mode = "rwc" if writing else "ro"
        with closing(sqlite3.connect(f"{self._path.absolute().as_uri()}?mode={mode}", _WAIT_S, uri=True)) as connection:
            layout = connection.execute("PRAGMA user_version").fetchone()[0]
            if layout == 0:
                if not writing:
                    raise _NotWrittenYet
                connection.execute(f"PRAGMA user_version = {_LAYOUT}")
            elif layout != _LAYOUT:
                raise ValueError(f"layout {layout}")
            connection.execute("PRAGMA synchronous = OFF")  # a power cut may cost the cache, never a version
            yield connection

    def _give_up(self, error: Exception) -> bool:
        """Remove a cache that is damaged. False where it is only out of reach for now (locked, full, read-only)."""
        if getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF in _PASSING:
            log.debug("%s: the index of versions is out of reach (%s)", self._path, error)
            return False
        log.warning("%s: the index of versions is damaged (%s); it is built again from the files", self._path, error)
        return self.drop()
