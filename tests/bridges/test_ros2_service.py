"""What the bridge tells its service manager."""

from __future__ import annotations

from typing import Any

from tests.bridges.ros_network import needs_ros
from tests.processes.manager import Manager

pytestmark = needs_ros


def test_the_bridge_is_ready_without_a_daemon_and_alive_while_it_spins(twin: Any) -> None:
    manager = Manager()
    twin._environment |= {"NOTIFY_SOCKET": manager.name, "WATCHDOG_USEC": "400000"}
    try:
        bridge = twin.start("bridge", "ros2")
        assert manager.hear("READY=1") == ["READY=1"]
        assert set(manager.hear("WATCHDOG=1")) == {"WATCHDOG=1"}
        manager.waiting()
        assert twin.end(bridge)[0] == 0
        assert "STOPPING=1" in manager.waiting()
    finally:
        manager.socket.close()
