"""Topics of a ROS 2 system as they look on Zenoh, so that a twin reads it with no ROS installed.

zenoh-bridge-ros2dds (https://github.com/eclipse-zenoh/zenoh-plugin-ros2dds) uses the bare topic name as the key and
plain CDR. rmw_zenoh (https://github.com/ros2/rmw_zenoh, docs/design.md) uses domain, topic, type and the hash of the
type's definition (REP 2016), and expects an attachment with sequence number, source time and writer.
"""

from __future__ import annotations

import itertools
import os
import time
from typing import Any

from zenoh.ext import Int64, z_serialize

from twin_daemon.daemon.settings import RosSettings

_TYPE = "sensor_msgs/msg/JointState"


class RosKeys:
    """The keys of one ROS 2 system. `subscribed` are those of the daemon's streams, `published` the prediction's."""

    def __init__(self, settings: RosSettings) -> None:
        self._with_attachment = settings.transport == "rmw_zenoh"
        self.subscribed = {
            stream: _key(settings, topic, own=False)
            for stream, topic in (
                ("joint_states", settings.joint_states),
                ("joint_commands", settings.joint_commands),
            )
        }
        self.published = _key(settings, settings.twin_joint_states, own=True)
        self._writer = os.urandom(16)
        self._numbers = itertools.count(1)

    def attachment(self) -> bytes | None:
        """What rmw_zenoh wants beside each message; None where the transport has none."""
        if not self._with_attachment:
            return None
        parts: tuple[Any, ...] = (
            "sequence_number", Int64(next(self._numbers)), "source_timestamp", Int64(time.time_ns()), "source_gid",
        )  # fmt: skip
        # the writer's id is serialised as a sequence of 16 bytes: its length comes first
        return b"".join(z_serialize(part).to_bytes() for part in parts) + bytes([len(self._writer)]) + self._writer


def _key(settings: RosSettings, topic: str, *, own: bool) -> str:
    if settings.transport == "ros2dds":
        return topic.strip("/")
    # a subscription does not insist on the definition of the type: the bytes are checked when they are decoded
    kind = f"{_dds_name(_TYPE)}/{type_hash(_TYPE)}" if own else "*/*"
    return f"{settings.domain}/{topic.strip('/')}/{kind}"


def _dds_name(message: str) -> str:
    """sensor_msgs/msg/JointState -> sensor_msgs::msg::dds_::JointState_."""
    package, folder, name = message.split("/")
    return f"{package}::{folder}::dds_::{name}_"


def type_hash(message: str) -> str:
    """The hash of a message's definition in ROS 2 Jazzy: "RIHS01_..." (REP 2016)."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY).hash_rihs01(message)
