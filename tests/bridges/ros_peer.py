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
from rclpy.action import ActionClient, ActionServer
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, Float64
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint


class Peer(Node):
    """Publishes as a hand's driver does, and listens as an operator's tools do."""

    def __init__(self) -> None:
        super().__init__("peer")
        self.heard: dict[str, list[Any]] = {"prediction": [], "residual": [], "diagnostics": []}
        self.latest: dict[str, Any] = {}
        self.copies: dict[str, Any] = {}
        self.kept: list[Any] = []
        self.finished = Future()
        self.create_subscription(JointState, "twin/joint_states", self._joints("prediction"), 100)
        self.create_subscription(JointState, "twin/residual", self._joints("residual"), qos_profile_sensor_data)
        self.create_subscription(DiagnosticArray, "/diagnostics", self._diagnostics, 10)
        self.out = {
            "joint_states": self.create_publisher(JointState, "joint_states", qos_profile_sensor_data),
            "joint_commands": self.create_publisher(JointState, "joint_commands", 10),
        }
        self.trajectories = {
            topic: self.create_publisher(JointTrajectory, topic, 10)
            for topic in ("joint_trajectory", "twin/trajectory", "/rh_trajectory_controller/command")
        }
        self.targets = self.create_publisher(JointState, "twin/target", 10)
        self.beats = self.create_publisher(Empty, "twin/heartbeat", 10)

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

    def ramp(self, names: list[str], start: list[float], end: list[float], count: int, rate_hz: float) -> None:
        """Streamed targets from one pose to another, without stamps."""
        begin_s = time.monotonic()
        for index in range(count):
            time.sleep(max(begin_s + index / rate_hz - time.monotonic(), 0.0))
            share = (index + 1) / count
            position = [a + share * (b - a) for a, b in zip(start, end, strict=True)]
            self.targets.publish(JointState(name=names, position=position))

    def beat(self, count: int, rate_hz: float) -> None:
        for _ in range(count):
            self.beats.publish(Empty())
            time.sleep(1.0 / rate_hz)

    def listen(self, topic: str, kind: str) -> None:
        """From now on what comes on a command topic is heard too: numbers, or a trajectory's only point."""
        self.heard[topic] = []
        note, form = {
            "Float64": (lambda message: self.heard[topic].append(message.data), Float64),
            "JointState": (self._joints(topic), JointState),
            "JointTrajectory": (self._points(topic), JointTrajectory),
        }[kind]

        def hear(message: Any) -> None:
            self.latest[topic] = message
            note(message)

        self.create_subscription(form, topic, hear, 100)
        self.copies[topic] = self.create_publisher(form, topic, 10)

    def copy(self, topic: str) -> None:
        """Says once more, to the last bit, what was heard last on a topic that it listens to."""
        self.copies[topic].publish(self.latest[topic])

    def _points(self, topic: str) -> Any:
        def hear(message: JointTrajectory) -> None:
            after_s = [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in message.points]
            positions = [list(point.positions) for point in message.points]
            told = {"names": list(message.joint_names), "positions": positions, "times_s": after_s}
            self.heard[topic].append(told | {"stamp_s": message.header.stamp.sec})

        return hear

    def offer(self, name: str, kind: str, success: bool = True) -> None:
        """A driver's service: notes what it is called with, and says whether it worked."""
        self.heard[name] = []

        def serve(request: Any, response: Any) -> Any:
            self.heard[name].append(getattr(request, "data", None))
            response.success, response.message = success, "" if success else "the driver is busy"
            return response

        self.create_service(SetBool if kind == "SetBool" else Trigger, name, serve)

    def serve(self, name: str) -> None:
        """An action whose goals go on until `finish`. Its type is as good as a controller's: nobody looks at it."""
        self.finished = Future()

        async def pursue(goal: Any) -> Any:
            await self.finished
            goal.succeed()
            return self.action.Result()

        self.kept.append(ActionServer(self, self.action, name, pursue))

    def finish(self) -> None:
        self.finished.set_result(None)

    def send_goal(self, executor: SingleThreadedExecutor, name: str) -> bool:
        """Whether a goal was accepted."""
        client = ActionClient(self, self.action, name)
        self.kept.append(client)
        assert client.wait_for_server(timeout_sec=10.0)
        accepted = client.send_goal_async(self.action.Goal())
        executor.spin_until_future_complete(accepted, timeout_sec=10.0)
        return accepted.result().accepted

    @property
    def action(self) -> Any:
        from test_msgs.action import Fibonacci

        return Fibonacci

    def trajectory(
        self, names: list[str], times_s: list[float], positions: list[list[float]], topic: str = "joint_trajectory"
    ) -> None:
        message = JointTrajectory(joint_names=names)
        for time_s, position in zip(times_s, positions, strict=True):
            point = JointTrajectoryPoint(positions=position)
            point.time_from_start.sec, point.time_from_start.nanosec = int(time_s), round(time_s % 1 * 1e9)
            message.points.append(point)
        self.trajectories[topic].publish(message)

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
            spun = {"executor": executor} if does in ("call", "send_goal") else {}
            done = getattr(peer, does)(**spun, **asked)
            print(json.dumps(done), flush=True)
        executor.spin_once(timeout_sec=0.01)
    executor.shutdown()
    peer.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
