"""ROS 1 bags."""

from __future__ import annotations

from pathlib import Path

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_typestore

from twin_daemon.recordings.bag import Contents, read_topics
from twin_daemon.recordings.unfinished_bag1 import readable_bag1
from twin_daemon.recordings.unpacking import bound_rosbags


def read_ros1(path: Path) -> Contents:
    """A ROS 1 bag (version 2.0), compressed or not, closed or left active."""
    bound_rosbags()
    with readable_bag1(path) as bag, Reader(bag.path) as reader:
        contents = read_topics(reader, get_typestore(Stores.ROS1_NOETIC), ros1=True)
    contents.notes += [bag.note] if bag.note else []
    return contents
