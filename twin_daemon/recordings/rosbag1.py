"""ROS 1 bags."""

from __future__ import annotations

from pathlib import Path

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from twin_daemon.recordings.bag import Contents, read_topics
from twin_daemon.recordings.unpacking import bound_rosbags


def read_ros1(path: Path) -> Contents:
    """A ROS 1 bag (version 2.0), compressed or not."""
    bound_rosbags()
    with Reader(path) as reader:
        return read_topics(reader, get_typestore(Stores.ROS1_NOETIC), ros1=True)
