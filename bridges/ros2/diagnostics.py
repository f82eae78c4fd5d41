"""The daemon's health and the bridge's own counts as diagnostic_msgs/DiagnosticArray."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.node import Node

from bridges.ros2.conversions import OK, WARN, diagnosis, gate_diagnosis, key_values
from bridges.ros2.link import ZenohLink
from bridges.ros2.requests import Requests
from twin_daemon.hand import HandDescription
from twin_daemon.services.guard import Guard

_LONGEST_WAIT_S = 2.0
_ANNOUNCED_S = 3.0  # it is said several times a second; who says nothing more has gone


class Diagnostics:
    """Asks the daemon how it is, once a period, and publishes what it says or that nobody answers.

    It asks instead of waiting for the daemon's own reports: those may come seldom, and a silence would prove nothing.
    """

    def __init__(
        self,
        node: Node,
        link: ZenohLink,
        requests: Requests,
        description: HandDescription,
        guard: Guard,
        period_s: float,
        clock: Clock,
        counts: Callable[[], dict[str, int]],
    ) -> None:
        self._node = node
        self._link = link
        self._requests = requests
        self._description = description
        self._guard = guard
        self._counts = counts
        self._key = description.key("health")
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self._timer = node.create_timer(period_s, guard.around("the diagnostics", self._ask), clock=clock)
        self.period_s = period_s
        self._announced: tuple[float, dict[str, Any]] = (0.0, {})

    def announced(self, payload: bytes) -> None:
        """A motion that begins by itself is coming, under way or over. Raises ValueError for no JSON object."""
        told = json.loads(payload)
        if not isinstance(told, dict):
            raise ValueError("an announcement is no JSON object")
        news = told.get("phase") != self._announced[1].get("phase")
        self._announced = time.monotonic(), told
        if news:
            self._ask()  # whoever watches the diagnostics is to see it at once

    def _automatic(self) -> DiagnosticStatus:
        heard_s, told = self._announced
        silent = time.monotonic() - heard_s > _ANNOUNCED_S
        if told.get("phase", "none") == "none" or silent:
            return self._status("automatic motion", OK, "no automatic motion", {})
        return self._status("automatic motion", WARN, str(told.get("words")), key_values(told))

    def change_period(self, period_s: float) -> None:
        self.period_s = period_s
        self._timer.timer_period_ns = round(period_s * 1e9)

    def _ask(self) -> None:
        # both answers are there before the next questions
        timeout_s = min(0.8 * self.period_s, _LONGEST_WAIT_S)
        heard: dict[str, Any] = {}

        def came(what: str, answer: Any) -> None:
            heard[what] = answer
            if len(heard) == 2:
                self._guard.run("the diagnostics", self._publish, heard["health"], heard["gate"])

        self._link.ask(self._key, timeout_s, lambda health: came("health", health))
        self._requests.look(lambda gate: came("gate", gate), timeout_s)

    def _publish(self, health: bytes | None, gate: dict[str, Any]) -> None:
        level, message, values = diagnosis(health, self._key)
        # whoever has just answered is connected, even where the link has not been told of it yet
        connected = health is not None or self._link.connected
        own = {"connected": str(connected).lower(), "endpoint": self._link.endpoint}
        own |= {name: str(count) for name, count in sorted(self._counts().items())}
        own_message = "connected with the twin" if connected else f"looking for the twin at {self._link.endpoint}"
        array = DiagnosticArray()
        array.header.stamp = self._node.get_clock().now().to_msg()
        array.status = [
            self._status("daemon", level, message, values),
            self._status("bridge", OK if connected else WARN, own_message, own),
        ]
        if "mode" in gate:  # a hand without motors has none
            array.status += [self._status("gate", *gate_diagnosis(gate)), self._automatic()]
        self._publisher.publish(array)

    def _status(self, part: str, level: int, message: str, values: dict[str, str]) -> DiagnosticStatus:
        return DiagnosticStatus(
            level=bytes([level]),
            name=f"{self._node.get_name()}: {part} of {self._description.namespace}",
            message=message,
            hardware_id=self._description.name,
            values=[KeyValue(key=key, value=value) for key, value in values.items()],
        )
