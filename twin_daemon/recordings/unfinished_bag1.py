"""A ROS 1 bag that was never closed (`.active`): a whole copy of its whole chunks, with an index made anew.

The format: wiki.ros.org/Bags/Format/2.0. An index is written when a bag is closed; all that it says stands in the
chunks as well.
"""

from __future__ import annotations

import struct
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from rosbags.rosbag1 import reader as ros1

from twin_daemon.recordings.budget import spend
from twin_daemon.recordings.unfinished import Readable, copy_bytes, left_out, nothing_whole, scratch

_MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _HEADER, _INDEX, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_LARGEST_HEADER = 1 << 20


@dataclass
class _Record:
    """Where a record's data are, and its header's fields."""

    fields: dict[bytes, bytes]
    begin: int
    data: int
    end: int

    @property
    def kind(self) -> int:
        return self.fields.get(b"op", b"\0")[0]


@dataclass
class _Chunk:
    """Where a chunk stands in the copy, and the (time, offset) of its messages by connection."""

    at: int
    messages: dict[int, list[tuple[bytes, int]]] = field(default_factory=lambda: defaultdict(list))


@contextmanager
def readable_bag1(path: Path) -> Iterator[Readable]:
    """A ROS 1 bag, or a whole copy of what of it is whole. Raises BadInput where nothing is."""
    with path.open("rb") as file:
        if file.read(len(_MAGIC)) != _MAGIC:
            yield Readable(path)
            return
        size = file.seek(0, 2)
        head = _record(file, len(_MAGIC), size)
        if head is None:
            raise nothing_whole(path)
        if head.kind != _HEADER or any(head.fields.get(b"index_pos", b"")):
            yield Readable(path)
            return
        with scratch() as folder:
            copy = Path(folder) / "whole.bag"
            with copy.open("wb") as target:
                whole = _copy(file, target, head, size)
            if whole is None:
                raise nothing_whole(path)
            yield Readable(copy, left_out(path.name, size - whole))


def _copy(file: BinaryIO, target: BinaryIO, head: _Record, size: int) -> int | None:
    """Copies whole chunks, each with its index, and the end; where the whole data end. None where there are none."""
    target.write(_MAGIC + bytes(head.end - len(_MAGIC)))
    connections: dict[int, bytes] = {}
    chunks: list[_Chunk] = []
    at = whole = head.end
    while (record := _record(file, at, size)) is not None:
        if record.kind == _CHUNK:
            chunk = _Chunk(target.tell())
            file.seek(record.data)
            unpack = ros1.decompressors[record.fields[b"compression"].decode()]
            _look(unpack(file.read(record.end - record.data)), chunk, connections)
            file.seek(record.begin)
            copy_bytes(file, target, record.end - record.begin)
            for connection, messages in chunk.messages.items():
                fields = {b"ver": _u4(1), b"conn": _u4(connection), b"count": _u4(len(messages))}
                target.write(_packed(_INDEX, fields, b"".join(time + _u4(offset) for time, offset in messages)))
            chunks.append(chunk)
        elif record.kind not in (_INDEX, _CONNECTION, _CHUNK_INFO):
            break
        at = whole = record.end
    if not any(chunk.messages for chunk in chunks):
        return None
    index_at = target.tell()
    for raw in connections.values():
        target.write(raw)
    for chunk in chunks:
        target.write(_chunk_info(chunk))
    counts = {b"conn_count": _u4(len(connections)), b"chunk_count": _u4(len(chunks))}
    first = _packed(_HEADER, {b"index_pos": struct.pack("<Q", index_at), **counts}, b"")
    padding = head.end - len(_MAGIC) - len(first)
    target.seek(len(_MAGIC))
    target.write(first[:-4] + _u4(padding) + b" " * padding)
    return whole


def _look(content: bytes, chunk: _Chunk, connections: dict[int, bytes]) -> None:
    """Notes the messages of a chunk's content, and the connections that it brings."""
    at = number = 0
    while at + 8 <= len(content):
        number += 1
        if number % 256 == 0:
            spend(256)
        (header_size,) = struct.unpack_from("<I", content, at)
        fields = _fields(content[at + 4 : at + 4 + header_size])
        (data_size,) = struct.unpack_from("<I", content, at + 4 + header_size)
        end = at + 8 + header_size + data_size
        (connection,) = struct.unpack("<I", fields[b"conn"])
        if fields[b"op"][0] == _MESSAGE:
            chunk.messages[connection].append((fields[b"time"], at))
        elif fields[b"op"][0] == _CONNECTION:
            connections.setdefault(connection, content[at:end])
        at = end


def _chunk_info(chunk: _Chunk) -> bytes:
    times = [time for messages in chunk.messages.values() for time, _ in messages] or [bytes(8)]
    in_order = sorted(times, key=lambda time: struct.unpack("<II", time))
    fields = {
        b"ver": _u4(1),
        b"chunk_pos": struct.pack("<Q", chunk.at),
        b"start_time": in_order[0],
        b"end_time": in_order[-1],
        b"count": _u4(len(chunk.messages)),
    }
    counts = b"".join(_u4(connection) + _u4(len(messages)) for connection, messages in chunk.messages.items())
    return _packed(_CHUNK_INFO, fields, counts)


def _record(file: BinaryIO, at: int, size: int) -> _Record | None:
    """The record at a place; None where it is not whole."""
    file.seek(at)
    head = file.read(4)
    if len(head) < 4 or not 0 < (header_size := struct.unpack("<I", head)[0]) <= _LARGEST_HEADER:
        return None
    header, data_size = file.read(header_size), file.read(4)
    data = at + 8 + header_size
    if len(data_size) < 4 or (end := data + struct.unpack("<I", data_size)[0]) > size:
        return None
    return _Record(_fields(header), at, data, end)


def _fields(header: bytes) -> dict[bytes, bytes]:
    found: dict[bytes, bytes] = {}
    at = 0
    while at + 4 <= len(header):
        (length,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + length].partition(b"=")
        found[name] = value
        at += 4 + length
    return found


def _packed(kind: int, fields: dict[bytes, bytes], data: bytes) -> bytes:
    entries = [name + b"=" + value for name, value in {b"op": bytes([kind]), **fields}.items()]
    header = b"".join(_u4(len(entry)) + entry for entry in entries)
    return _u4(len(header)) + header + _u4(len(data)) + data


def _u4(value: int) -> bytes:
    return struct.pack("<I", value)
