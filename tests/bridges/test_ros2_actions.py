"""Goals of actions that somebody else sends to the hand's controllers, past the gate: rclpy servers and clients."""

from __future__ import annotations

import time
from typing import Any

import pytest

from tests.bridges.ros_network import Peer, needs_ros
from tests.bridges.test_ros2_commands import Scene, armed, call, scene
from tests.processes.conftest import until

pytestmark = needs_ros
__all__ = ["scene"]

CONTROLLERS, ELSEWHERE = "/rh_trajectory_controller/follow_joint_trajectory", "/camera/look_around"


@pytest.mark.slow
def test_a_goal_of_a_controller_ends_the_motion_and_the_next_while_it_lasts(
    scene: Scene, peers: tuple[Peer, Peer]
) -> None:
    pytest.importorskip("test_msgs", reason="it has the actions that the peers offer")
    driver, operator = peers
    scene.twin.start("bridge", "ros2", "--ros-args", "-p", "identity:=operator", "-p", "lease_s:=300.0")

    def moves(seconds: float) -> dict[str, Any]:
        """The gate after a stream of so long, or when it has tripped."""
        end_s = time.monotonic() + seconds
        while (gate := scene.gate())["mode"] == "armed" and time.monotonic() < end_s:
            operator.do("ramp", names=["rh_FFJ3"], start=[0.0], end=[0.1], count=10, rate_hz=50.0)
        return gate

    driver.do("serve", name=ELSEWHERE)
    armed(operator)
    assert driver.do("send_goal", name=ELSEWHERE)
    assert moves(2.0)["mode"] == "armed"  # no controller's
    driver.do("finish")

    operator.do("serve", name=CONTROLLERS)
    assert driver.do("send_goal", name=CONTROLLERS)
    words = f"past the gate: a goal of {CONTROLLERS} from "
    gate = moves(10.0)
    assert gate["mode"] == "read_only"
    assert words in gate["ended"]  # at once, whether or not the graph shows already who sent it
    until(lambda: call(operator, "arm")["success"], 20.0)  # the goal still drives the hand
    gate = moves(10.0)
    assert gate["mode"] == "read_only"
    assert f"{words}the ROS 2 node /driver" in gate["ended"]

    operator.do("finish")
    time.sleep(1.0)
    until(lambda: call(operator, "arm")["success"], 20.0)
    assert moves(2.0)["mode"] == "armed"
