"""The ways in: services and topics that become requests to the gate. What it refuses, the hand never sees."""

from __future__ import annotations

import time
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.task import Future
from sensor_msgs.msg import JointState
from std_msgs.msg import Empty, Header
from std_srvs.srv import Trigger
from trajectory_msgs.msg import JointTrajectory

from bridges.ros2.conversions import target_body, trajectory_body, trigger_reply
from bridges.ros2.parameters import ARM_REASON, LEASE
from bridges.ros2.requests import Requests
from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.services.guard import Guard
from twin_daemon.services.stop_report import AFTER_S, stop_report

VERBS = ("arm", "disarm", "stop", "release", "recalibrate", "cancel")
# Of a stream the newest target is the one that counts.
_STREAM = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class Commands:
    """Offers twin/arm and its likes, and hears twin/target, twin/trajectory and twin/heartbeat.

    A coroutine waits for the answer to a service, so that joint states flow on meanwhile; for that the services need
    a callback group that lets other callbacks in.
    """

    def __init__(self, node: Node, requests: Requests, guard: Guard) -> None:
        self._node = node
        self._requests = requests
        self._guard = guard
        self._beating = False
        self._group, self._steady = ReentrantCallbackGroup(), Clock(clock_type=ClockType.STEADY_TIME)
        for verb in VERBS:
            node.create_service(Trigger, f"twin/{verb}", self._service(verb), callback_group=self._group)
        self._subscribe(JointState, "twin/target", self._target, _STREAM)
        self._subscribe(JointTrajectory, "twin/trajectory", self._trajectory, QoSProfile(depth=10))
        self._subscribe(Empty, "twin/heartbeat", self._heartbeat, _STREAM)

    def _subscribe(self, kind: Any, topic: str, callback: Any, qos: QoSProfile) -> None:
        options = QoSOverridingOptions.with_default_policies()
        guarded = self._guard.around(f"a message of {topic}", callback)
        self._node.create_subscription(kind, topic, guarded, qos, qos_overriding_options=options)

    # -- services ------------------------------------------------------------------------------------------

    def _service(self, verb: str) -> Any:
        async def serve(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            try:
                answer = Future()
                self._requests.ask(verb, self._body(verb), answer.set_result)
                told = await answer or {}
                if verb == "stop" and told.get("accepted") is True:
                    await self._after(AFTER_S)
                    status = Future()
                    self._requests.look(status.set_result, after_stop=True)
                    told = stop_report(told, await status)
                response.success, response.message = trigger_reply(verb, told)
            except Exception as error:
                self._guard.failed(f"the service {verb}", error)
                response.success, response.message = False, f"the bridge failed: {error!r:.200}"
            return response

        return serve

    def _after(self, seconds: float) -> Future:
        """Done after so long, by the machine's own clock."""
        passed = Future()

        def end() -> None:
            timer.cancel()
            self._node.destroy_timer(timer)
            passed.set_result(None)

        timer = self._node.create_timer(seconds, end, callback_group=self._group, clock=self._steady)
        return passed

    def _body(self, verb: str) -> dict[str, Any]:
        if verb == "arm":
            lease_s = self._node.get_parameter(LEASE).value or 0.0
            reason = {"reason": self._node.get_parameter(ARM_REASON).value or ""}
            return reason | ({"lease_s": lease_s} if lease_s > 0.0 else {})
        return {"reason": f"{verb} over ROS 2"} if verb in ("stop", "release", "cancel") else {}

    # -- topics --------------------------------------------------------------------------------------------

    def _target(self, message: JointState) -> None:
        self._requests.stream(self._counted("target", target_body, message), self._asked_ns(message.header))

    def _trajectory(self, message: JointTrajectory) -> None:
        asked_ns = self._asked_ns(message.header)
        if message.points:
            body = self._counted("trajectory", trajectory_body, message)
            self._requests.ask("trajectory", body, stamp_ns=asked_ns)
        else:
            # to controllers this means: come to rest
            self._requests.ask("disarm", {}, stamp_ns=asked_ns)

    def _heartbeat(self, _: Empty) -> None:
        if self._beating:  # the last one is still on its way
            return
        self._beating = True

        def heard(_: dict[str, Any]) -> None:
            self._beating = False

        self._requests.ask("beat", {}, heard)

    def _counted(self, verb: str, read: Any, message: Any) -> dict[str, Any]:
        try:
            return read(message)
        except MalformedPayload as error:
            self._requests.counts[f"command.{verb}.{error.kind}"] += 1
            raise

    def _asked_ns(self, header: Header) -> int | None:
        """The stamp on the machine's clock, also where ROS has another one; None where there is no stamp."""
        stamp_ns = header.stamp.sec * 1_000_000_000 + header.stamp.nanosec
        if stamp_ns == 0:
            return None
        return max(time.time_ns() - (self._node.get_clock().now().nanoseconds - stamp_ns), 0)
