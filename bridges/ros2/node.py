"""The ROS node: topics on one side, the link to the twin on the other. All of it runs in the executor's thread."""

from __future__ import annotations

import logging
import time
from collections import Counter
from functools import partial
from typing import Any

import numpy as np
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from bridges.ros2.action_goals import ActionGoals
from bridges.ros2.command_publisher import RosCommandPublisher, trajectory_content
from bridges.ros2.commands import Commands
from bridges.ros2.controllers import ControllerTopics
from bridges.ros2.conversions import trajectory_message
from bridges.ros2.diagnostics import Diagnostics
from bridges.ros2.driver_stop import RosDriverStop
from bridges.ros2.link import ZenohLink
from bridges.ros2.own_messages import OwnMessages
from bridges.ros2.parameters import PERIOD, declare_parameters
from bridges.ros2.publishers import others_on
from bridges.ros2.requests import Requests
from bridges.ros2.trajectories import TrajectoryFollower
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample, MalformedPayload
from twin_daemon.services.guard import Guard
from twin_daemon.services.residual_message import known_residual

log = logging.getLogger("twin.bridge")

NODE_NAME = "twin_bridge"
_CONNECT_PERIOD_S = 0.1
_FRESH_S = 1.0  # an older measurement does not say where a joint is
_LOOK_AGAIN_S = 1.0  # who publishes on a topic is not asked for every message of a stream
# That somebody commands the hand, where no target can be told.
_NOTHING_SAID = cdr.encode(JointSample(0, (), np.zeros(0)))
# The sensor-data profile with a deeper queue: at 1 kHz its five messages are gone in a 5 ms stall.
_SENSOR = QoSProfile(
    history=HistoryPolicy.KEEP_LAST,
    depth=100,
    reliability=ReliabilityPolicy.BEST_EFFORT,
    durability=DurabilityPolicy.VOLATILE,
)


class TwinBridge(Node):
    """Joint states and commands of ROS to the twin; its prediction, residual and health to ROS.

    Requests to move the hand go to the gate, and what the gate sends goes to ROS where that is asked for.
    """

    def __init__(self, given: dict[str, str]) -> None:
        """`given` are parameters from the command line. Raises BadInput or an exception of rclpy for unusable ones."""
        super().__init__(NODE_NAME, parameter_overrides=[Parameter(name, value=value) for name, value in given.items()])
        self.guard = Guard(log)
        self._trajectories: Counter[str] = Counter()
        # of the joint states: payload, and arrival on the monotonic clock
        self._latest: tuple[bytes, float] = (b"", float("-inf"))
        self._follower = TrajectoryFollower()
        self._followed = ""  # who sent what it follows
        self._own = OwnMessages()
        self._others: dict[str, tuple[float, str]] = {}  # by topic: until when it holds, who publishes there
        self._controllers: ControllerTopics | None = None
        self.settings = settings = declare_parameters(self)
        guard = self.guard.around
        self._wake = self.create_guard_condition(guard("a message of the twin", self._settle))
        self.link = ZenohLink(settings.endpoint, settings.description, self._wake.trigger, settings.identity)
        self.requests = Requests(self.link, settings.description, settings.signer, settings.identity)
        try:
            outward = {"qos_profile": 10, "qos_overriding_options": QoSOverridingOptions.with_default_policies()}
            self._out = {
                "twin_joint_states": self.create_publisher(JointState, "twin/joint_states", **outward),
                "residual": self.create_publisher(JointState, "twin/residual", **outward),
            }
            for stream in self._out:
                self.link.hear(settings.description.key(stream), partial(self._publish, stream))
            self.link.hear(settings.description.key("events"), guard("an event", self.requests.heard_event))
            published = settings.command_output != "none"
            if settings.description.stop is not None and settings.description.stop.ros_service is not None:
                RosDriverStop(self, self.link, settings.description, self.guard)
            if published:
                RosCommandPublisher(self, self.link, settings, self._own, self.guard)
            self._subscribe(JointState, settings.joint_states_topic, self._measured, _SENSOR, raw=True)
            self._subscribe(JointState, settings.joint_commands_topic, self._commanded, _SENSOR, raw=True)
            # a single message that matters, which controllers take reliably as well
            self._subscribe(JointTrajectory, settings.trajectory_topic, self._trajectory, QoSProfile(depth=10))
            self._follow_timer = self.create_timer(
                1.0 / settings.command_rate_hz, guard("a trajectory", self._follow), autostart=False
            )
            # by the machine's own clock: a simulated one may stand still
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self.create_timer(_CONNECT_PERIOD_S, guard("the connection", self._connect), clock=steady)
            if settings.watch_controllers:
                self._controllers = ControllerTopics(self, settings.description, self._own, self._wake.trigger, _SENSOR)
                commanded = {
                    settings.trajectory_topic,
                    *map(settings.description.position_topic, settings.description.commands),
                }
                ActionGoals(self, set(map(self.resolve_topic_name, commanded)), self._pursued, self.guard, steady)
            Commands(self, self.requests, self.guard)
            self._diagnostics = Diagnostics(
                self,
                self.link,
                self.requests,
                settings.description,
                self.guard,
                settings.diagnostics_period_s,
                steady,
                self.counts,
            )
            self.link.hear(
                settings.description.key("announcement"), guard("an announcement", self._diagnostics.announced)
            )
            self.add_post_set_parameters_callback(self._parameters_changed)
        except BaseException:
            self._withdraw()
            raise

    def _subscribe(self, kind: Any, topic: str, callback: Any, qos: QoSProfile, raw: bool = False) -> None:
        options = QoSOverridingOptions.with_default_policies()
        guarded = self.guard.around(f"a message of {topic}", callback)
        self.create_subscription(kind, topic, guarded, qos, qos_overriding_options=options, raw=raw)

    def close(self) -> None:
        """Withdraws from both networks; all threads are quiet before the node goes."""
        self._withdraw()
        self.destroy_node()

    def _withdraw(self) -> None:
        if self._controllers is not None:
            self._controllers.close()
        self.link.close()

    def counts(self) -> dict[str, int]:
        """Messages by stream and by what became of them."""
        trajectories = {f"trajectory.{kind}": count for kind, count in self._trajectories.items()}
        own = {"errors": self.guard.errors, "dropped": self.link.inbox.dropped}
        return dict(self.link.counts) | dict(self.requests.counts) | trajectories | own

    # -- ROS to the twin -----------------------------------------------------------------------------------

    def _measured(self, payload: bytes) -> None:
        self._latest = payload, time.monotonic()
        self.link.put("joint_states", payload)

    def _commanded(self, payload: bytes, info: Any) -> None:
        topic = self.resolve_topic_name(self.settings.joint_commands_topic)
        if not self._own.take(topic, payload, info["source_timestamp"]):
            self._follower.forget()
            self._foreign("joint_commands", payload, self._others_on(topic))

    def _controlled(self, topic: str, targets: dict[str, float]) -> None:
        """Somebody else has sent targets (rad) to position controllers."""
        self._follower.forget()
        command = JointSample(self._now_ns(), tuple(targets), np.array(list(targets.values())))
        self._foreign("position_controllers", cdr.encode(command), self._others_on(topic))

    def _pursued(self, by: str) -> None:
        """Somebody else's goal moves the hand: which targets follow from it only its controller knows."""
        self._follower.forget()
        self._foreign("action_goal", _NOTHING_SAID, by)

    def _foreign(self, form: str, payload: bytes, by: str) -> None:
        """A command past the gate: the twin follows it, and the gate learns whose it is."""
        self.link.counts[f"foreign.{form}"] += 1
        self.link.put("joint_commands", payload, by)

    def _others_on(self, topic: str) -> str:
        now_s = time.monotonic()
        until_s, found = self._others.get(topic, (0.0, ""))
        if now_s > until_s:
            found = others_on(self, topic)
            self._others[topic] = now_s + _LOOK_AGAIN_S, found
        return found

    def _trajectory(self, message: JointTrajectory, info: Any) -> None:
        topic = self.resolve_topic_name(self.settings.trajectory_topic)
        if self._own.take(topic, trajectory_content(message), info["source_timestamp"]):
            return
        self._followed = self._others_on(topic)
        try:
            positions: dict[str, float] | None = None

            def measured(name: str) -> float | None:
                nonlocal positions
                if positions is None:
                    positions = self._positions()
                return positions.get(name)

            self._follower.accept(trajectory_message(message, self._now_ns()), measured)
        except MalformedPayload as error:
            self._trajectories[error.kind] += 1
            self._foreign("trajectory", _NOTHING_SAID, self._followed)
            raise
        self._trajectories["followed"] += 1
        if not message.points:  # the hand is told to stop where it is
            self._foreign("trajectory", _NOTHING_SAID, self._followed)
        self._follow()
        if self._follower.active:
            self._follow_timer.reset()

    def _positions(self) -> dict[str, float]:
        """Where the joints are, rad; nothing if that is not known."""
        payload, arrival_s = self._latest
        if time.monotonic() - arrival_s > _FRESH_S:
            return {}
        try:
            sample = cdr.decode(payload)
        except MalformedPayload:
            return {}
        return dict(zip(sample.names, sample.position.tolist(), strict=False))

    def _follow(self) -> None:
        command = self._follower.sample(self._now_ns())
        if command is not None:
            self._foreign("trajectory", cdr.encode(command), self._followed)
        if not self._follower.active:
            self._follow_timer.cancel()

    def _now_ns(self) -> int:
        return self.get_clock().now().nanoseconds

    # -- the twin to ROS -----------------------------------------------------------------------------------

    def _connect(self) -> None:
        self.link.tend()
        self.link.settle()

    def _settle(self) -> None:
        self.link.settle()
        if self._controllers is not None:
            self._controllers.settle(self._controlled)

    def _publish(self, stream: str, payload: bytes) -> None:
        try:
            if stream == "residual":
                payload = cdr.encode(known_residual(payload))
            self._out[stream].publish(payload)
            self.link.counts[f"{stream}.published"] += 1
        except Exception as error:  # one message, not those behind it
            self.guard.failed(f"a message of {stream}", error)

    def _parameters_changed(self, parameters: list[Parameter]) -> None:
        for parameter in parameters:
            if parameter.name == PERIOD:
                self._diagnostics.change_period(parameter.get_parameter_value().double_value)
