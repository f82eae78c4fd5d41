"""A ROS 2 node of its own in a process of its own: it does what its standard input says, one JSON object a line.

Run as a script. It listens to the twin's topics all the time; "take" hands over what has come.
"""

from __future__ import annotations

import json
import select
import sys
import time
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


class Peer(Node):
    """Publishes as a hand's driver does, and listens as an operator's tools do."""

    def __init__(self) -> None:
        super().__init__("peer")
        self.heard: dict[str, list[dict[str, Any]]] = {"prediction": [], "residual": [], "diagnostics": []}
        self.create_subscription(JointState, "twin/joint_states", self._joints("prediction"), 100)
        self.create_subscription(JointState, "twin/residual", self._joints("residual"), qos_profile_sensor_data)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._diagnostics, 10)
        self.out = {
            "joint_states": self.create_publisher(JointState, "joint_states", qos_profile_sensor_data),
            "joint_commands": self.create_publisher(JointState, "joint_commands", 10),
        }
        self.trajectories = self.create_publisher(JointTrajectory, "joint_trajectory", 10)

    def _joints(self, kind: str) -> Any:
        def hear(message: JointState) -> None:
            stamp = message.header.stamp
            self.heard[kind].append(
                {
                    "stamp_ns": stamp.sec * 1_000_000_000 + stamp.nanosec,
                    "arrival_ns": time.time_ns(),
                    "names": list(message.name),
                    "position": list(message.position),
                }
            )

        return hear

    def _diagnostics(self, message: DiagnosticArray) -> None:
        self.heard["diagnostics"].append(
            {
                status.name.split(": ")[1].split()[0]: {
                    "level": status.level[0],
                    "message": status.message,
                    "values": {pair.key: pair.value for pair in status.values},
                }
                for status in message.status
            }
        )

    # -- what can be asked ---------------------------------------------------------------------------------

    def take(self) -> dict[str, Any]:
        heard, self.heard = self.heard, {kind: [] for kind in self.heard}
        return heard

    def publish(self, topic: str, names: list[str], position: list[float], count: int, rate_hz: float) -> list[int]:
        """The same pose `count` times; the stamps in ns."""
        stamps = []
        begin_s = time.monotonic()
        for index in range(count):
            time.sleep(max(begin_s + index / rate_hz - time.monotonic(), 0.0))
            now_ns = time.time_ns()
            message = JointState(name=names, position=position)
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(now_ns, 1_000_000_000)
            self.out[topic].publish(message)
            stamps.append(now_ns)
        return stamps

    def publish_bytes(self, topic: str, payload: str) -> None:
        self.out[topic].publish(bytes.fromhex(payload))

    def trajectory(self, names: list[str], times_s: list[float], positions: list[list[float]]) -> None:
        message = JointTrajectory(joint_names=names)
        for time_s, position in zip(times_s, positions, strict=True):
            point = JointTrajectoryPoint(positions=position)
            point.time_from_start.sec, point.time_from_start.nanosec = int(time_s), round(time_s % 1 * 1e9)
            message.points.append(point)
        self.trajectories.publish(message)

    def call(self, executor: SingleThreadedExecutor, name: str) -> dict[str, Any]:
        client = self.create_client(Trigger, name)
        there = client.wait_for_service(timeout_sec=10.0)
        begin_s = time.monotonic()
        future = client.call_async(Trigger.Request())
        executor.spin_until_future_complete(future, timeout_sec=5.0)
        took_s = time.monotonic() - begin_s
        self.destroy_client(client)
        if not there or not future.done():
            return {"success": None, "message": "no response", "seconds": took_s}
        response = future.result()
        return {"success": response.success, "message": response.message, "seconds": took_s}


def main() -> None:
    rclpy.init()
    peer = Peer()
    executor = SingleThreadedExecutor()
    executor.add_node(peer)
    print(json.dumps("ready"), flush=True)
    while True:
        if select.select([sys.stdin], [], [], 0.0)[0]:
            line = sys.stdin.readline()
            if not line:
                break
            asked = json.loads(line)
            does = asked.pop("do")
            done = peer.call(executor, **asked) if does == "call" else getattr(peer, does)(**asked)
            print(json.dumps(done), flush=True)
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    peer.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
