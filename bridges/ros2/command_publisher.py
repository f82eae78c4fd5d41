"""The way out to a hand that ROS drives: the only place of this bridge that publishes commands.

It hears for itself what has left the gate, and there is no other way to make it publish.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable
from typing import Any

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from bridges.ros2.link import ZenohLink
from bridges.ros2.own_messages import OwnMessages
from bridges.ros2.parameters import Parameters
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.services.guard import Guard

_STALE_S = 0.5


class RosCommandPublisher:
    """Publishes what the gate has sent, as the parameter `command_output` says.

    What is older than 0.5 s is left out: a bridge that stood still does not make up for it in a burst.
    """

    def __init__(self, node: Node, link: ZenohLink, settings: Parameters, own: OwnMessages, guard: Guard) -> None:
        self._node = node
        self._commands = settings.description.commands
        self._counts = link.counts
        self._own = own
        self._form = self._forms(settings)[settings.command_output]()
        key = settings.description.key("command", verb="sent")
        link.hear(key, guard.around("a command of the gate", self._pass_on))

    def _pass_on(self, payload: bytes) -> None:
        try:
            self._form(self._checked(payload), payload)
        except MalformedPayload as error:
            self._counts[f"sent.{error.kind}"] += 1
            raise
        self._counts["sent.published"] += 1

    def _checked(self, payload: bytes) -> JointSample:
        command = cdr.decode(payload)
        if len(command.position) != len(command.names) or not np.isfinite(command.position).all():
            raise MalformedPayload("malformed", "one finite number a command is needed")
        unknown = next((name for name in command.names if name not in self._commands), None)
        if unknown is not None:
            raise MalformedPayload("unknown_names", f"this hand has no command '{unknown:.50}'")
        age_s = (time.time_ns() - command.stamp_ns) * 1e-9
        if abs(age_s) > _STALE_S:
            raise MalformedPayload("stale", f"it is {age_s:.3f} s old, at most {_STALE_S} s are allowed, either way")
        return command

    # -- the forms -----------------------------------------------------------------------------------------

    def _forms(self, settings: Parameters) -> dict[str, Callable[[], Callable[[JointSample, bytes], None]]]:
        return {
            "joint_commands": lambda: self._joint_commands(settings.joint_commands_topic),
            "trajectory": lambda: self._trajectory(settings.trajectory_topic, 1.0 / settings.command_rate_hz),
            "position_controllers": lambda: self._position_controllers(settings.description.position_topic),
        }

    def _joint_commands(self, topic: str) -> Callable[[JointSample, bytes], None]:
        publisher = self._publisher(JointState, topic)

        def publish(_: JointSample, payload: bytes) -> None:
            self._say(publisher, payload, payload)

        return publish

    def _trajectory(self, topic: str, period_s: float) -> Callable[[JointSample, bytes], None]:
        publisher = self._publisher(JointTrajectory, topic)

        def publish(command: JointSample, _: bytes) -> None:
            # without a stamp: it holds from when it arrives, whatever the clocks of the two machines say
            message = JointTrajectory(joint_names=list(command.names))
            point = JointTrajectoryPoint(positions=command.position.tolist())
            point.time_from_start.nanosec = round(period_s * 1e9) % 1_000_000_000
            point.time_from_start.sec = int(period_s)
            message.points = [point]
            self._say(publisher, message, trajectory_content(message))

        return publish

    def _position_controllers(self, topic_of: Callable[[str], str]) -> Callable[[JointSample, bytes], None]:
        publishers = {name: self._publisher(Float64, topic_of(name)) for name in self._commands}

        def publish(command: JointSample, _: bytes) -> None:
            for name, value in zip(command.names, command.position.tolist(), strict=True):
                self._say(publishers[name], Float64(data=value), value)

        return publish

    def _say(self, publisher: Any, message: Any, content: Hashable) -> None:
        with self._own.publishing(publisher.topic_name, content):
            publisher.publish(message)

    def _publisher(self, kind: Any, topic: str) -> Any:
        options = QoSOverridingOptions.with_default_policies()
        return self._node.create_publisher(kind, topic, QoSProfile(depth=10), qos_overriding_options=options)


def trajectory_content(message: JointTrajectory) -> Hashable:
    """What tells one trajectory from another: joints, and positions and times of the points."""
    points = tuple(
        (tuple(point.positions), point.time_from_start.sec, point.time_from_start.nanosec) for point in message.points
    )
    return message.header.stamp.sec, message.header.stamp.nanosec, tuple(message.joint_names), points
