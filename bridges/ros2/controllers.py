"""The topics of the hand's position controllers, where anybody may move a motor past the gate."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Float64

from bridges.ros2.own_messages import OwnMessages
from twin_daemon.hand import HandDescription
from twin_daemon.services.guard import Guard

log = logging.getLogger("twin.bridge")

_PERIOD_S = 0.01
Foreign = Callable[[str, dict[str, float]], None]


class _Polled(CallbackGroup):
    """Leaves its subscriptions to whoever polls them. An executor of rclpy looks at each of its entities at every turn:
    twenty more would cost it half a millisecond each time, though hardly anything ever comes."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        return


class ControllerTopics:
    """Hears every position controller's topic in a thread of its own, and calls `wake` when somebody else has spoken
    there; `settle` then hands that over in the caller's thread."""

    def __init__(
        self, node: Node, description: HandDescription, own: OwnMessages, wake: Callable[[], None], qos: QoSProfile
    ) -> None:
        group = _Polled()
        self._topics: list[tuple[str, Any]] = [
            (
                command,
                node.create_subscription(
                    Float64, description.position_topic(command), lambda _: None, qos, callback_group=group
                ),
            )
            for command in description.commands
        ]
        self._own = own
        self._wake = wake
        self._guard = Guard(log)
        self._heard: SimpleQueue[tuple[str, str, float]] = SimpleQueue()  # topic, command, rad
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="twin-controllers", daemon=True)
        self._thread.start()

    def settle(self, then: Foreign) -> None:
        """Calls `then` with a topic's name and the targets, rad by command, that others have sent since the last call;
        the topic is that of the first of them."""
        targets: dict[str, float] = {}
        first = ""
        while True:
            try:
                topic, command, value = self._heard.get_nowait()
            except Empty:
                break
            first = first or topic
            targets[command] = value
        if targets:
            then(first, targets)

    def _watch(self) -> None:
        while not self._stop.wait(_PERIOD_S):
            for command, subscription in self._topics:
                self._guard.run("a position controller's topic", self._take, command, subscription)

    def _take(self, command: str, subscription: Any) -> None:
        while (taken := subscription.handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            message, info = taken
            topic = subscription.topic_name
            if not self._own.take(topic, message.data, info["source_timestamp"]):
                self._heard.put((topic, command, message.data))
                self._wake()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
