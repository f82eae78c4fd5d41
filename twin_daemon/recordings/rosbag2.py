"""ROS 2 bags: a folder with metadata.yaml, or the storage files alone (of a recorder that was killed, for example)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from twin_daemon.recordings.bag import Contents, read_topics
from twin_daemon.recordings.mcap_chunks import ChunkedBag
from twin_daemon.recordings.unfinished import Readable, readable
from twin_daemon.recordings.unpacking import bound_rosbags
from twin_daemon.yaml_files import MAX_BYTES, load_yaml

STORAGE_SUFFIXES = (".mcap", ".db3")


def storage_files(folder: Path) -> list[Path]:
    """The storage files of a bag's folder, in the order in which they were written."""
    files = [path for path in folder.iterdir() if path.suffix in STORAGE_SUFFIXES and path.is_file()]
    # rosbag2 splits a bag into name_0, name_1, ... name_10
    return sorted(files, key=lambda path: (len(path.name), path.name))


def read_ros2(path: Path) -> Contents:
    """A folder with metadata.yaml, a folder of storage files, or one storage file, of a killed recorder as well."""
    bound_rosbags()
    about = path / "metadata.yaml"
    if about.is_file():
        with about.open(encoding="utf-8") as text:
            load_yaml(text.read(MAX_BYTES + 1))  # within bounds, of which rosbags has none
    with ExitStack() as stack:
        if about.exists():  # it is written when a recorder ends
            files = [Readable(path)]
        else:
            files = [
                stack.enter_context(readable(each)) for each in ([path] if path.is_file() else storage_files(path))
            ]
        contents = _read([stack.enter_context(Reader(each.path)) for each in files])
    contents.notes += [each.note for each in files if each.note]
    return contents


def message_types() -> Typestore:
    """The types of ROS 2: what is read here is the same in every distribution. The first call loads their modules."""
    return get_typestore(Stores.ROS2_JAZZY)


def _read(readers: Sequence[Reader]) -> Contents:
    typestore = message_types()
    if chunked := ChunkedBag.of(readers):
        return read_topics(chunked, typestore, ros1=False)
    if len(readers) == 1:
        return read_topics(readers[0], typestore, ros1=False)
    return read_topics(_Chain(readers), typestore, ros1=False)


class _Chain:
    """Several storage files of one bag, read one after the other as if they were one."""

    def __init__(self, readers: Sequence[Reader]) -> None:
        self._readers = readers
        self.connections: list[Connection] = []
        self._ids: dict[tuple[int, int], int] = {}
        for index, reader in enumerate(readers):
            for connection in reader.connections:
                unique = len(self.connections)
                self._ids[index, connection.id] = unique
                self.connections.append(connection._replace(id=unique))

    def messages(self, connections: Sequence[Connection]) -> Iterator[tuple[Connection, int, bytes]]:
        wanted = {connection.id: connection for connection in connections}
        for index, reader in enumerate(self._readers):
            own = [c for c in reader.connections if self._ids[index, c.id] in wanted]
            if not own:
                continue
            for connection, received_ns, raw in reader.messages(own):
                yield wanted[self._ids[index, connection.id]], received_ns, raw
