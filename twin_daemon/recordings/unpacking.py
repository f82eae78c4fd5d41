"""What strangers have packed is unpacked within bounds: a few bytes can stand for more than a disk holds.

rosbags unpacks whatever a bag asks for and believes its database, so its readers are given bounded parts.
"""

from __future__ import annotations

from bz2 import BZ2Decompressor
from collections.abc import Callable
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rosbags.rosbag1 import reader as ros1
from rosbags.rosbag2 import reader as ros2
from rosbags.rosbag2 import storage_mcap, storage_sqlite3

from twin_daemon.errors import BadInput

SLACK_BYTES = 256 * 2**20
RATIO = 200
"""Joint states of a hand that stands still without noise pack to a hundredth."""


def most_bytes(packed: int) -> int:
    """How much `packed` bytes may become."""
    return SLACK_BYTES + RATIO * packed


def too_much(packed: int) -> BadInput:
    """What is said of more."""
    return BadInput(
        f"{packed} packed bytes unpack to more than {most_bytes(packed)}: no recording does",
        todo="Unpack it with a tool you trust, and look at it",
    )


@cache
def bound_rosbags() -> None:
    """Gives the readers of rosbags their bounds, once. LZ4 has its own: it becomes at most 255 times as much."""
    ros1.decompressors["bz2"] = _unpacker(BZ2Decompressor)
    packer: Any = ros2.zstd  # type: ignore[attr-defined]
    zstd = _unpacker(packer.ZstdDecompressor)
    storage_mcap.DECOMPRESSORS["zstd"] = lambda data, _: zstd(data)
    ros2.zstd = SimpleNamespace(decompress=zstd, open=_opener(packer.open))  # type: ignore[attr-defined]
    open_tables = storage_sqlite3.Sqlite3Reader._open

    def open_plain(self: storage_sqlite3.Sqlite3Reader) -> None:
        _require_plain_tables(Path(str(self.path)))
        open_tables(self)

    storage_sqlite3.Sqlite3Reader._open = open_plain


def _unpacker(make: Callable[[], Any]) -> Callable[[bytes], bytes]:
    def unpack(data: bytes) -> bytes:
        packed, unpacked = len(data), b""
        while True:  # one frame after the other
            decompressor = make()
            unpacked += decompressor.decompress(data, most_bytes(packed) + 1 - len(unpacked))
            if len(unpacked) > most_bytes(packed):
                raise too_much(packed)
            if not decompressor.eof:
                raise EOFError("packed data that end too early")
            if not (data := decompressor.unused_data):
                return unpacked

    return unpack


def _opener(open_packed: Callable[..., Any]) -> Callable[..., Any]:
    @contextmanager
    def opened(raw: Any, mode: str) -> Any:
        packed = Path(raw.name).stat().st_size
        with open_packed(raw, mode) as text:
            left = most_bytes(packed)

            def read(size: int) -> bytes:
                nonlocal left
                piece = text.read(size)
                left -= len(piece)
                if left < 0:
                    raise too_much(packed)
                return piece

            yield SimpleNamespace(read=read)

    return opened


def _require_plain_tables(path: Path) -> None:
    """A database may compute what it is asked for, without end: views, triggers, virtual tables, generated columns."""
    apsw = storage_sqlite3.apsw  # type: ignore[attr-defined]
    connection = apsw.Connection(f"file:{path}?immutable=1", flags=apsw.SQLITE_OPEN_READONLY | apsw.SQLITE_OPEN_URI)
    try:
        found = connection.execute(
            "SELECT (SELECT count(*) FROM sqlite_master "
            "WHERE type NOT IN ('table', 'index') OR sql LIKE 'CREATE VIRTUAL%') "
            "+ (SELECT count(*) FROM sqlite_master AS t, pragma_table_xinfo(t.name) AS c "
            "WHERE t.type = 'table' AND c.hidden != 0)"
        ).fetchone()
    finally:
        connection.close()
    if found != (0,):
        raise BadInput("its database computes what is in it", allowed="plain tables, as 'ros2 bag' writes them")
