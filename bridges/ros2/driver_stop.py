"""The stop of a driver that offers it as a ROS 2 service: called whenever the gate is stopped."""

from __future__ import annotations

from typing import Any

import zenoh
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool, Trigger

from bridges.ros2.link import ZenohLink
from bridges.zenoh.driver_stop import answered
from twin_daemon.hand import HandDescription
from twin_daemon.services.guard import Guard


class RosDriverStop:
    """Answers the gate with what the service said, or that there is none."""

    def __init__(self, node: Node, link: ZenohLink, description: HandDescription, guard: Guard) -> None:
        stop = description.stop
        if stop is None or stop.ros_service is None:
            raise ValueError("this hand's description names no service to stop it")
        self._name = stop.ros_service
        self._guard = guard
        self._key = description.key("driver_stop")
        set_bool = stop.ros_type == "std_srvs/SetBool"
        self._request: Any = SetBool.Request(data=stop.set_bool) if set_bool else Trigger.Request()
        self._client = node.create_client(SetBool if set_bool else Trigger, self._name)
        link.serve(self._key, guard.around("a stop of the driver", self._asked))

    def _asked(self, query: zenoh.Query) -> None:
        if not self._client.service_is_ready():
            self._answer(query, False, f"no ROS 2 service {self._name}")
            return

        def heard(future: Future) -> None:
            response: Any = future.result()
            done = response is not None and bool(response.success)
            self._answer(query, done, None if done else str(getattr(response, "message", "no response")))

        self._client.call_async(self._request).add_done_callback(
            self._guard.around("the answer of the driver's stop", heard)
        )

    def _answer(self, query: zenoh.Query, done: bool, why: str | None) -> None:
        with query:
            query.reply(self._key, answered(done, why), encoding="application/json")
