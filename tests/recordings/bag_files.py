"""Bags written by rosbags, to be read back: what a message says, and one writer for each form of bag."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

ROS1 = get_typestore(Stores.ROS1_NOETIC)
ROS2 = get_typestore(Stores.ROS2_JAZZY)
FORMS = ("bag", "bag_lz4", "mcap", "mcap_file", "mcap_zstd", "sqlite", "db3_file")
CUSTOM = "acme_msgs/msg/Oddity"


@dataclass(frozen=True)
class JointState:
    stamp_ns: int
    names: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float] = ()
    effort: Sequence[float] = ()
    topic: str = "/joint_states"
    received_ns: int | None = None


@dataclass(frozen=True)
class Trajectory:
    stamp_ns: int
    names: Sequence[str]
    points: Sequence[tuple[float, Sequence[float]]]
    received_ns: int
    topic: str = "/rh_trajectory_controller/command"


@dataclass(frozen=True)
class Float64:
    value: float
    received_ns: int
    topic: str


@dataclass(frozen=True)
class Custom:
    received_ns: int
    topic: str = "/oddity"


Message = JointState | Trajectory | Float64 | Custom


def write_bag(form: str, folder: Path, messages: Sequence[Message], name: str = "motion") -> Path:
    """A bag of one of FORMS; returns the path that names the recording."""
    ros1 = form.startswith("bag")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_JAZZY)
    store.register(get_types_from_msg("float64 strange\nstring[] things", CUSTOM))
    path = folder / (f"{name}.bag" if ros1 else name)
    with _writer(form, path) as writer:
        connections: dict[tuple[str, str], Any] = {}
        for message in messages:
            kind, built = _built(message, store, ros1)
            key = (message.topic, kind)
            if key not in connections:
                connections[key] = writer.add_connection(message.topic, kind, typestore=store)
            serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
            received_ns = message.received_ns
            if received_ns is None:
                received_ns = message.stamp_ns
            writer.write(connections[key], received_ns, bytes(serialize(built, kind)))
    if form == "mcap_file":
        return path / f"{name}.mcap"
    return path / f"{name}.db3" if form == "db3_file" else path


def joint_state_bytes(message: JointState, *, ros1: bool, little_endian: bool = True, frame: str = "") -> bytes:
    store = ROS1 if ros1 else ROS2
    kind, built = _built(message, store, ros1, frame)
    if ros1:
        return bytes(store.serialize_ros1(built, kind))
    return bytes(store.serialize_cdr(built, kind, little_endian=little_endian))


def _writer(form: str, path: Path) -> Any:
    if form.startswith("bag"):
        writer1 = Writer1(path)
        if form == "bag_lz4":
            writer1.set_compression(Writer1.CompressionFormat.LZ4)
        return writer1
    plugin = StoragePlugin.MCAP if form.startswith("mcap") else StoragePlugin.SQLITE3
    writer2 = Writer2(path, version=9, storage_plugin=plugin)
    if form == "mcap_zstd":
        writer2.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    return writer2


def _built(message: Message, store: Any, ros1: bool, frame: str = "") -> tuple[str, Any]:
    types = store.types
    if isinstance(message, Custom):
        return CUSTOM, types[CUSTOM](strange=1.0, things=["a", "b"])
    if isinstance(message, Float64):
        return "std_msgs/msg/Float64", types["std_msgs/msg/Float64"](data=message.value)
    seconds, nanoseconds = divmod(message.stamp_ns, 10**9)
    fields = {"stamp": types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds), "frame_id": frame}
    if ros1:
        fields["seq"] = 7
    header = types["std_msgs/msg/Header"](**fields)
    if isinstance(message, JointState):
        kind = "sensor_msgs/msg/JointState"
        arrays = {key: np.array(getattr(message, key), dtype=float) for key in ("position", "velocity", "effort")}
        return kind, types[kind](header=header, name=list(message.names), **arrays)
    kind, point = "trajectory_msgs/msg/JointTrajectory", types["trajectory_msgs/msg/JointTrajectoryPoint"]
    none, duration = np.array([], dtype=float), types["builtin_interfaces/msg/Duration"]
    points = [
        point(
            positions=np.array(target, dtype=float),
            velocities=none,
            accelerations=none,
            effort=none,
            time_from_start=duration(sec=int(after_s), nanosec=round(after_s % 1 * 1e9)),
        )
        for after_s, target in message.points
    ]
    return kind, types[kind](header=header, joint_names=list(message.names), points=points)
