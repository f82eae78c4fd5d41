"""What hand and twin say, served over the Foxglove websocket protocol while it happens.

The joint streams keep the topics and the bytes that `twin record` gives them, so that one layout shows a recording and
the live hand. Nothing is heard from viewers: they see, and move nothing.
"""

from __future__ import annotations

import json
import logging
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

from rosbags.typesys import Stores, get_typestore

from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.errors import BadInput
from twin_daemon.hand import HandDescription
from twin_daemon.recordings.joint_state_wire import JOINT_STATE
from twin_daemon.services.guard import Guard
from twin_daemon.services.recorder import TOPICS, Listen, as_joint_state

log = logging.getLogger("twin.bridge")

EVENTS, HEALTH, VERSION, MODEL = "/twin/events", "/twin/health", "/twin/version", "/twin/model"
_LEVELS = {"error": "Error", "alarm": "Error", "refused": "Warning", "drift": "Warning", "changed": "Warning"}

Ask = Callable[[str], dict[str, Any] | None]
"""The daemon's answer to a question by its name; None where it does not answer."""


def require_foxglove() -> None:
    """Raises BadInput where the extra is not installed."""
    try:
        import foxglove  # noqa: F401
    except ImportError:
        raise BadInput(
            "the Foxglove SDK is not installed", todo="Install the extra: pip install 'twin_daemon[foxglove]'"
        ) from None


class FoxgloveBridge:
    """A server of one hand's streams, from the start to `close`. `counts` says how many of each topic went through.

    Raises BadInput where the port cannot be had.
    """

    def __init__(self, listen: Listen, ask: Ask, description: HandDescription, host: str, port: int) -> None:
        import foxglove
        from foxglove.channels import LogChannel

        self.counts: Counter[str] = Counter()
        self._ask = ask
        self._guard = Guard(log)
        self._context = foxglove.Context()
        definition = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(JOINT_STATE, ros_version=2)[0]
        schema = foxglove.Schema(name=JOINT_STATE, encoding="ros2msg", data=definition.encode())
        self._streams = {
            stream: foxglove.Channel("/" + topic, schema=schema, message_encoding="cdr", context=self._context)
            for stream, topic in TOPICS.items()
        }
        self._events = LogChannel(EVENTS, context=self._context)
        self._told = {name: foxglove.Channel(name, context=self._context) for name in (HEALTH, VERSION, MODEL)}
        name = f"twin_daemon, {description.namespace}"
        try:
            self._server = foxglove.start_server(name=name, host=host, port=port, context=self._context)
        except RuntimeError as error:
            raise BadInput(
                f"cannot listen ({error})", where=f"{host}:{port}", todo="Choose another --port or --bind"
            ) from None
        self._ends = [
            *(listen(description.key(stream), partial(self._heard, stream)) for stream in TOPICS),
            listen(description.key("events"), partial(self._guard.run, "an event", self._event)),
            listen(description.key("health"), partial(self._guard.run, "health", self._health)),
        ]

    @property
    def port(self) -> int:
        return self._server.port

    def tell_model(self) -> None:
        """Says which version is in use, and its MJCF, to those who have come since."""
        for topic, question in ((VERSION, "version"), (MODEL, "model")):
            found = self._ask(question)
            if found is not None:
                self._told[topic].log(found)
                self.counts[topic] += 1

    def close(self) -> None:
        for end in self._ends:
            end()
        self._server.stop()

    def _heard(self, stream: str, payload: bytes) -> None:
        try:
            _, message = as_joint_state(stream, payload)
        except MalformedPayload:
            self.counts["refused"] += 1
            return
        self._streams[stream].log(message, log_time=time.time_ns())
        self.counts["/" + TOPICS[stream]] += 1

    def _event(self, payload: bytes) -> None:
        from foxglove.messages import Log, LogLevel, Timestamp

        event = json.loads(payload)
        seconds, nanoseconds = divmod(int(event.get("stamp_ns") or time.time_ns()), 1_000_000_000)
        level = getattr(LogLevel, next((to for part, to in _LEVELS.items() if part in event["kind"]), "Info"))
        self._events.log(
            Log(timestamp=Timestamp(seconds, nanoseconds), level=level, name=event["kind"], message=event["text"])
        )
        self.counts[EVENTS] += 1

    def _health(self, payload: bytes) -> None:
        self._told[HEALTH].log(json.loads(payload))
        self.counts[HEALTH] += 1
