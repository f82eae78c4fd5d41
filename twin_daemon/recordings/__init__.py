"""Recordings of a robot hand, read from every form in which they come and written as ROS 2 bags."""

from __future__ import annotations

from twin_daemon.recordings.joint_map import load_joint_map
from twin_daemon.recordings.load import load_offered, load_recording
from twin_daemon.recordings.quality import Quality
from twin_daemon.recordings.recording import Commands, Recording
from twin_daemon.recordings.writer import McapWriter

__all__ = ["Commands", "McapWriter", "Quality", "Recording", "load_joint_map", "load_offered", "load_recording"]
