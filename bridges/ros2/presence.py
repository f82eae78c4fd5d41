"""Whether ROS 2 can be used here."""

from __future__ import annotations

import importlib

from twin_daemon.errors import BadInput

_PACKAGES = ("rclpy", "sensor_msgs.msg", "std_msgs.msg", "trajectory_msgs.msg", "diagnostic_msgs.msg", "std_srvs.srv")


def require_ros() -> None:
    """Raises BadInput that says what to install where a package is missing or does not load."""
    for name in _PACKAGES:
        try:
            importlib.import_module(name)
        except ImportError as error:
            raise BadInput(
                f"ROS 2 cannot be used by this Python: {error}",
                todo="Run 'make setup-ros', or source a system-wide Jazzy: source /opt/ros/jazzy/setup.bash",
            ) from None
