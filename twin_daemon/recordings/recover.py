"""Brings back what a recorder had written when it was killed."""

from __future__ import annotations

import fcntl
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from twin_daemon.errors import BadInput
from twin_daemon.recordings.mcap_file import (
    CHANNEL,
    CHUNK,
    DATA_END,
    MAGIC,
    MESSAGE,
    MESSAGE_HEAD,
    RECORD_HEAD,
    StreamWriter,
)

_CHUNK_HEAD = 40  # times, size, checksum, the empty name of the compression, size again
_LARGEST = 2**30  # of a record; more is not what a recorder wrote


def recover(part: Path, target: Path) -> int:
    """Copies every whole message of an unfinished recording into a whole one; how many. `part` stays as it is.

    Raises BadInput for a file that is no such recording, holds no message, or is still being written.
    """
    try:
        file = part.open("rb")
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", where=part) from None
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise BadInput("is still being written", where=part, todo="Stop its recorder first") from None
        if not MAGIC.startswith(file.read(len(MAGIC))):  # nothing at all: killed before the first message
            raise BadInput("not an MCAP file", where=part)
        writer = StreamWriter(target)
        try:
            _copy(file, writer)
            if not writer.messages:
                raise BadInput("holds no whole message", where=part)
            writer.finish()
        except (KeyError, IndexError, ValueError, struct.error):
            writer.discard()
            raise BadInput("not written by this program", where=part, todo="Try 'mcap recover'") from None
        except BaseException:
            writer.discard()
            raise
    return writer.messages


def _copy(file: BinaryIO, writer: StreamWriter) -> None:
    channels: dict[int, int] = {}
    for kind, body in _channels_and_messages(file):
        if kind == CHANNEL:
            number, topic, about = _channel(body)
            channels[number] = writer.add_channel(topic, **about)
        elif kind == MESSAGE:
            number, _, log_ns, publish_ns = MESSAGE_HEAD.unpack_from(body)
            writer.write(channels[number], log_ns, publish_ns, body[MESSAGE_HEAD.size :])


def _channels_and_messages(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """In the order of the file, up to the place where its writer was killed."""
    while len(head := file.read(RECORD_HEAD.size)) == RECORD_HEAD.size:
        kind, size = RECORD_HEAD.unpack(head)
        if kind == DATA_END or size > _LARGEST or len(body := file.read(size)) < size:
            return
        if kind == CHANNEL:
            yield kind, body
        elif kind == CHUNK:
            records = body[_CHUNK_HEAD:]
            expected, compression = struct.unpack_from("<II", body, 24)
            if compression:
                raise ValueError("compressed")
            if crc32(records) != expected:
                return  # blocks of a file that a loss of power left empty
            yield from _records(records)


def _records(records: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(records):
        kind, size = RECORD_HEAD.unpack_from(records, at)
        at += RECORD_HEAD.size
        yield kind, records[at : at + size]
        at += size


def _channel(body: bytes) -> tuple[int, str, dict[str, str]]:
    """Number, topic, and the words about it."""
    (number,) = struct.unpack_from("<H", body)
    topic, at = _text(body, 4)
    _, at = _text(body, at)  # cdr
    at += 4  # the size of the words, which end with the record
    words: dict[str, str] = {}
    while at < len(body):
        key, at = _text(body, at)
        words[key], at = _text(body, at)
    return number, topic, words


def _text(body: bytes, at: int) -> tuple[str, int]:
    """The text that begins at a place, and the place behind it."""
    (size,) = struct.unpack_from("<I", body, at)
    end = at + 4 + size
    return body[at + 4 : end].decode(), end
