"""The messages of an MCAP file a chunk at a time: one by one, ten minutes at 1 kHz take several times as long.

rosbags reads the index and decompresses; what is done here is to find the messages within a chunk (MCAP specification,
"Chunk" and "Message") without making an object of each.
"""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from rosbags.rosbag2 import Reader
from rosbags.rosbag2.storage_mcap import ChunkInfo, McapReader, decompress

from twin_daemon.errors import BadInput
from twin_daemon.recordings.batch import Batch
from twin_daemon.recordings.budget import spend
from twin_daemon.recordings.mcap_file import MESSAGE, MESSAGE_HEAD, MESSAGE_INDEX, RECORD_HEAD

_HEAD = struct.Struct(RECORD_HEAD.format + MESSAGE_HEAD.format[1:])  # a message: both in one
_HEADS = np.dtype(
    [
        ("kind", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("received_ns", "<u8"),
        ("published_ns", "<u8"),
    ]
)
_INDEX_HEAD = struct.Struct(RECORD_HEAD.format + "HI")  # of the messages of one channel in the chunk before it
_ENTRY = np.dtype([("received_ns", "<u8"), ("at", "<u8")])
_EVERY = 1024
_MOST_IN_CHUNK = 4_000_000  # recorders write chunks of a few MiB
_CHUNK_HEAD = struct.Struct("<BQQQQI")  # kind, size; first, last, size of the content, its checksum


class ChunkedBag:
    """The files of a bag, one after the other, where all can be read by chunks; `connections` have ids of their own."""

    def __init__(self, storages: Sequence[McapReader]) -> None:
        self._storages = storages
        each = [(storage, connection) for storage in storages for connection in storage.connections]
        self.connections = [connection._replace(id=unique) for unique, (_, connection) in enumerate(each)]
        self._ids = [
            {connection.id: unique for unique, (owner, connection) in enumerate(each) if owner is storage}
            for storage in storages
        ]

    @classmethod
    def of(cls, readers: Sequence[Reader]) -> ChunkedBag | None:
        """None unless all files are indexed and their chunks follow each other in time, which rosbag2 grants."""
        storages = [each for reader in readers for each in getattr(reader.storage, "storages", [reader.storage])]
        if any(reader.compression_mode == "message" for reader in readers):
            return None
        fit = all(isinstance(storage, McapReader) and _in_time(storage.chunks) for storage in storages)
        return cls([storage for storage in storages if isinstance(storage, McapReader)]) if fit else None

    def batches(self, wanted: Collection[int]) -> Iterator[Batch]:
        """What was said on some connections, chunk by chunk. Raises ReaderError or struct.error for damaged files."""
        for storage, ids in zip(self._storages, self._ids, strict=True):
            channels = {channel: unique for channel, unique in ids.items() if unique in wanted}
            for chunk in storage.chunks:
                if any(chunk.channel_count.get(channel, 0) for channel in channels):
                    content = _content(storage, chunk)
                    yield _by_index(storage, chunk, content, channels) or _messages(content, channels)


def _in_time(chunks: list[ChunkInfo]) -> bool:
    return bool(chunks) and all(
        before.message_end_time <= after.message_start_time for before, after in pairwise(chunks)
    )


def _content(storage: McapReader, chunk: ChunkInfo) -> bytes:
    file = storage.bio
    assert file is not None
    file.seek(chunk.chunk_start_offset)
    head = file.read(_CHUNK_HEAD.size)
    file.seek(chunk.chunk_start_offset + 49 + len(chunk.compression))
    content = file.read(chunk.compressed_size)
    return decompress(content, chunk.compression, chunk.uncompressed_size, _CHUNK_HEAD.unpack(head)[5])


def _by_index(storage: McapReader, chunk: ChunkInfo, content: bytes, channels: Mapping[int, int]) -> Batch | None:
    """The same as `_messages`, in one step, where the chunk's index names all its records; None where it does not.

    An index is what a file says of itself: it is believed only where the records that it names fill the chunk without
    a gap, so that none can be hidden or come twice.
    """
    at = _indexed(storage, chunk)
    if not len(at) or at[0] != 0 or int(at[-1]) + _HEAD.size > len(content):
        return None
    heads = np.lib.stride_tricks.sliding_window_view(np.frombuffer(content, np.uint8), _HEAD.size)[at]
    heads = heads.view(_HEADS)[:, 0]
    if (heads["length"] > len(content)).any() or (heads["received_ns"] >= 2**63).any():
        return None
    end = at + RECORD_HEAD.size + heads["length"].astype(np.int64)
    if (heads["kind"] != MESSAGE).any() or (at[1:] != end[:-1]).any() or end[-1] != len(content):
        return None
    spend(len(at))
    named = np.full(2**16, -1)
    named[list(channels)] = list(channels.values())
    connection, received_ns = named[heads["channel"]], heads["received_ns"].astype(np.int64)
    rows = np.stack([connection, at + _HEAD.size, end, received_ns], axis=1)
    return _in_order(content, rows[connection >= 0])


def _indexed(storage: McapReader, chunk: ChunkInfo) -> np.ndarray:
    """(n,) where the records behind a chunk say that its messages begin, ascending; empty where they make no sense."""
    file = storage.bio
    assert file is not None
    if not 0 < chunk.message_index_length <= _MOST_IN_CHUNK * _ENTRY.itemsize:
        return np.empty(0, dtype=np.int64)
    file.seek(chunk.chunk_start_offset + chunk.chunk_length)
    index = file.read(chunk.message_index_length)
    found, at = [], 0
    while at + _INDEX_HEAD.size <= len(index):
        kind, _, _, size = _INDEX_HEAD.unpack_from(index, at)
        at += _INDEX_HEAD.size
        if kind != MESSAGE_INDEX or size % _ENTRY.itemsize or at + size > len(index):
            break
        found.append(np.frombuffer(index, _ENTRY, size // _ENTRY.itemsize, at)["at"])
        at += size
    places = np.concatenate(found) if found else np.empty(0, np.uint64)
    return np.sort(np.minimum(places, 2**62).astype(np.int64))


def _messages(content: bytes, channels: Mapping[int, int]) -> Batch:
    """The messages of some channels, under the connections that these are."""
    found: list[tuple[int, int, int, int]] = []
    at, size, ahead, records = 0, len(content), len(content) - _HEAD.size, 0
    while at < size:
        records += 1
        if records % _EVERY == 0:
            spend(_EVERY)
            if records > _MOST_IN_CHUNK:
                raise BadInput(f"more than {_MOST_IN_CHUNK} messages are in one of its chunks")
        if at <= ahead:
            kind, length, channel, _, received_ns, _ = _HEAD.unpack_from(content, at)
        else:  # too short for a message
            (kind, length), channel, received_ns = RECORD_HEAD.unpack_from(content, at), -1, 0
        end = at + RECORD_HEAD.size + length
        if end > size:
            raise struct.error(f"a record of {length} bytes at {at} ends behind its chunk")
        if kind == MESSAGE and channel in channels:
            found.append((channels[channel], at + _HEAD.size, end, received_ns))
        at = end
    return _in_order(content, np.array(found, dtype=np.int64).reshape(-1, 4))


def _in_order(content: bytes, rows: np.ndarray) -> Batch:
    """Messages (n, 4), each by its connection, begin, end and time of receiving, in the order of the last."""
    if (np.diff(rows[:, 3]) < 0).any():
        rows = rows[np.argsort(rows[:, 3], kind="stable")]
    return Batch(content, rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 3])
