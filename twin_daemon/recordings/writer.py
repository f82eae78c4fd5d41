"""Writes joint states and commands as a ROS 2 bag (MCAP), which ros2, Foxglove and rosbags open."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from twin_daemon.errors import BadInput
from twin_daemon.files import sync_folder
from twin_daemon.recordings.joint_state_wire import JOINT_STATE, SECOND_NS

_MAX_STAMP_NS = 2**31 * SECOND_NS  # the seconds of a ROS stamp are 32 bits with a sign


class McapWriter:
    """A ROS 2 bag that appears whole, or not at all.

    A path that ends with .mcap becomes that single file, any other a folder with metadata.yaml. It is written beside
    its place and moved there at the end, so that an interrupted writer leaves nothing under the final name.
    Not for several threads at once.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        if self.path.exists() or self.path.is_symlink():
            raise BadInput("exists already", where=self.path, todo="Choose another name or remove it")
        if not self.path.parent.is_dir():
            raise BadInput("the folder for the recording does not exist", where=self.path.parent, todo="Create it")
        store = get_typestore(Stores.ROS2_JAZZY)
        self._store = store
        self._joint_state = store.types[JOINT_STATE]
        self._header = store.types["std_msgs/msg/Header"]
        self._time = store.types["builtin_interfaces/msg/Time"]
        self._writer: Writer | None = None
        self._building: Path | None = None
        self._topics: dict[str, Connection] = {}
        self.messages = 0

    def __enter__(self) -> McapWriter:
        try:
            self._building = Path(tempfile.mkdtemp(prefix=f".{self.path.name}.", suffix=".tmp", dir=self.path.parent))
            self._writer = Writer(self._building / self.path.stem, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        except OSError as error:
            self._discard()
            raise BadInput(f"cannot be written ({error.strerror})", where=self.path) from None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._writer is not None
        try:
            if kind is None:
                self._writer.close()
                self._publish()
            else:
                self._writer.abort()
        finally:
            self._discard()

    def joint_states(
        self,
        stamp_ns: int,
        names: Sequence[str],
        position: Sequence[float] | np.ndarray,
        velocity: Sequence[float] | np.ndarray | None = None,
        effort: Sequence[float] | np.ndarray | None = None,
        topic: str = "joint_states",
        received_ns: int | None = None,
    ) -> None:
        """One sensor_msgs/JointState: `position` (k,) rad, `velocity` (k,) rad/s. Received at its stamp if not said."""
        if self._writer is None:
            raise RuntimeError("McapWriter is used in a with statement")
        if not 0 <= stamp_ns < _MAX_STAMP_NS:
            raise BadInput(f"stamp {stamp_ns} ns does not fit into a ROS message", where=self.path)
        arrays = [_array(values, len(names), self.path) for values in (position, velocity, effort)]
        if len(arrays[0]) != len(names):
            raise BadInput(f"{len(arrays[0])} positions for {len(names)} joints", where=self.path)
        seconds, nanoseconds = divmod(int(stamp_ns), SECOND_NS)
        message = self._joint_state(
            header=self._header(stamp=self._time(sec=seconds, nanosec=nanoseconds), frame_id=""),
            name=list(names),
            position=arrays[0],
            velocity=arrays[1],
            effort=arrays[2],
        )
        raw = self._store.serialize_cdr(message, JOINT_STATE)
        self._writer.write(self.add_topic(topic), int(stamp_ns if received_ns is None else received_ns), raw)
        self.messages += 1

    def joint_commands(
        self,
        stamp_ns: int,
        names: Sequence[str],
        position: Sequence[float] | np.ndarray,
        topic: str = "joint_commands",
        received_ns: int | None = None,
    ) -> None:
        """One message of position targets (k,) rad, by the name of the actuated joint, J0 included."""
        self.joint_states(stamp_ns, names, position, topic=topic, received_ns=received_ns)

    def add_topic(self, topic: str) -> Connection:
        """Declares a topic of joint states, so that it is in the bag even if nothing is written to it."""
        if self._writer is None:
            raise RuntimeError("McapWriter is used in a with statement")
        absolute = "/" + topic.strip("/")
        if absolute not in self._topics:
            self._topics[absolute] = self._writer.add_connection(absolute, JOINT_STATE, typestore=self._store)
        return self._topics[absolute]

    def _publish(self) -> None:
        assert self._building is not None
        built = self._building / self.path.stem
        if self.path.suffix == ".mcap":
            built = built / f"{built.name}.mcap"
        if self.path.exists():
            raise BadInput("appeared while the recording was written", where=self.path, todo="Choose another name")
        built.rename(self.path)
        sync_folder(self.path.parent)

    def _discard(self) -> None:
        building, self._building, self._writer = self._building, None, None
        if building is not None:
            shutil.rmtree(building, ignore_errors=True)


def _array(values: Sequence[float] | np.ndarray | None, count: int, path: Path) -> np.ndarray:
    array = np.ascontiguousarray([] if values is None else values, dtype=np.float64)
    if array.ndim != 1 or array.size not in (0, count):
        raise BadInput(f"{array.size} values for {count} joints", where=path)
    return array
