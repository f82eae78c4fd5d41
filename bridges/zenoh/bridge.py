"""The daemon on Zenoh: hand and commands in, prediction, residual, events and health out, questions answered."""

from __future__ import annotations

import json
import logging
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import zenoh

from bridges.zenoh.ros_keys import RosKeys
from bridges.zenoh.sources import Sources
from bridges.zenoh.streams import heard_keys, subscriptions
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import ROS_SOURCE, JointSample, MalformedPayload
from twin_daemon.daemon.service import TwinService
from twin_daemon.services.durations import Durations
from twin_daemon.services.guard import Guard
from twin_daemon.services.inbox import Inbox
from twin_daemon.services.ring import Ring
from twin_daemon.services.stop import Stoppable

log = logging.getLogger(__name__)
Answer = Callable[[str], dict[str, Any] | None]
_ACTS = ("diagnose",)


class ZenohBridge:
    """Carries messages between one Zenoh session and one service.

    The transport's threads only put bytes into the inbox; `run` is the loop. Questions are answered on the
    transport's threads under the service's own lock. `extra` adds questions, by the name of their key in the
    hand's description; an answer gets what was asked beyond the key's fixed part ("" for the key itself). What goes
    in and out is kept in `ring`, too. With `ros` the same streams go under a ROS 2 system's keys as well.
    """

    def __init__(
        self,
        session: zenoh.Session,
        service: TwinService,
        extra: dict[str, Answer] | None = None,
        ring: Ring | None = None,
        ros: RosKeys | None = None,
    ) -> None:
        self.service = service
        self._ring = ring or Ring(0.0, 0)
        self.inbox = Inbox()
        self._session = session
        self._key = service.hand.description.key
        self._latency = Durations()
        self._guard = Guard(log)
        self._publishers = {
            name: session.declare_publisher(
                self._key(name), encoding=encoding, congestion_control=zenoh.CongestionControl.DROP
            )
            for name, encoding in (
                ("twin_joint_states", "application/cdr"),
                ("residual", "application/json"),
                ("events", "application/json"),
                ("health", "application/json"),
            )
        }
        answers: dict[str, Answer] = {
            name: (lambda _key, ask=ask: ask())
            for name, ask in {
                "state": service.state,
                "residual": service.residual,
                "version": service.version,
                "drift": service.drift,
                "model": service.model,
                "events": service.recent_events,
                "health": self.health,
            }.items()
        }
        self._entities = [self._declare_question(key, answer) for key, answer in (answers | (extra or {})).items()]
        self._sources = Sources(session)
        service.names_source = self._sources.named
        self._entities += self._subscribe_streams(heard_keys(service.hand.description))
        self._ros = ros
        if ros is not None:
            self._entities += self._subscribe_streams(ros.subscribed, ROS_SOURCE)
            self._publishers["ros"] = session.declare_publisher(
                ros.published, encoding="application/cdr", congestion_control=zenoh.CongestionControl.DROP
            )
        # last, so that whoever sees it can ask at once
        self._token = session.liveliness().declare_token(self._key("alive"))

    # -- declarations --------------------------------------------------------------------------------------

    def _subscribe_streams(self, keys: dict[str, str], by: str = "") -> list[Any]:
        return [self._subscribe(key, streams, by) for key, streams in subscriptions(keys).items()]

    def _subscribe(self, expression: str, streams: dict[str, str], by: str) -> Any:
        def sort(sample: zenoh.Sample) -> None:
            # a key with wildcards is that of a single stream
            stream = streams.get(expression) or streams.get(str(sample.key_expr))
            if stream is not None:
                self.inbox.put(stream, sample.payload.to_bytes(), by + self._sources.of(sample))

        return self._session.declare_subscriber(expression, sort)

    def _declare_question(self, name: str, answer: Answer) -> Any:
        key = self._key(name)
        fixed = key.removesuffix("/**")

        def reply(query: zenoh.Query) -> None:
            try:
                with query:
                    asked = str(query.key_expr)
                    if "*" in asked and name in _ACTS:
                        return  # to ask for everything is to look, and looking begins nothing
                    # a selector with wildcards asks several at once: each answers under its own key
                    own = fixed if "*" in asked else asked
                    found = answer(own.removeprefix(fixed).strip("/"))
                    if found is None:
                        query.reply_err(json.dumps({"schema": 1, "error": f"there is nothing at {own}"}))
                    else:
                        query.reply(own, json.dumps(found, allow_nan=False), encoding="application/json")
            except Exception as error:
                self._guard.failed(f"the answer to {name}", error)

        return self._session.declare_queryable(key, reply)

    # -- the loop ------------------------------------------------------------------------------------------

    def run(self, stop: Stoppable, seconds: float | None = None, each_turn: Callable[[], None] | None = None) -> None:
        """Works until `stop` is set or `seconds` have passed. An error costs one message, never the loop."""
        end_s = None if seconds is None else time.monotonic() + seconds
        next_health_s = 0.0
        while not stop.is_set() and (end_s is None or time.monotonic() < end_s):
            for stream, payload, arrival_s, source in self.inbox.take(timeout_s=0.05):
                self._guard.run(f"a message of {stream}", self._handle, stream, payload, arrival_s, source)
            self._guard.run("the events", self._publish_events)
            if time.monotonic() >= next_health_s:
                next_health_s = time.monotonic() + self.service.settings.health_period_s
                self._guard.run("health", self._publish_health)
            if each_turn is not None:
                self._guard.run("a turn of the loop", each_turn)

    def _handle(self, stream: str, payload: bytes, arrival_s: float, source: str) -> None:
        try:
            sample = replace(cdr.decode(payload), source=source)
        except MalformedPayload as error:
            self.service.refuse(stream, error.kind)
            return
        self._ring.add(stream, sample.stamp_ns, payload, arrival_s)
        if stream == "joint_commands":
            self.service.on_command(sample)
            return
        output = self.service.on_joint_state(sample, lambda prediction: self._send(prediction, arrival_s))
        if output is not None and output.residual_due:
            residual = self._put("residual", self.service.residual_now())
            self._ring.add("residual", output.prediction.stamp_ns, residual.encode(), time.monotonic())

    def _send(self, prediction: JointSample, arrival_s: float) -> None:
        predicted = cdr.encode(prediction)
        self._publishers["twin_joint_states"].put(predicted)
        if self._ros is not None:
            self._publishers["ros"].put(predicted, attachment=self._ros.attachment())
        sent_s = time.monotonic()
        self._latency.add(sent_s - arrival_s)
        self._ring.add("twin_joint_states", prediction.stamp_ns, predicted, sent_s)

    def _publish_events(self) -> None:
        for event in self.service.take_events():
            log.info("%s: %s", event.kind, event.text)
            self._put("events", event.as_json())

    def _publish_health(self) -> None:
        self._put("health", self.health())

    def _put(self, name: str, value: dict[str, Any]) -> str:
        text = json.dumps(value, allow_nan=False)
        self._publishers[name].put(text)
        return text

    # -- health --------------------------------------------------------------------------------------------

    def health(self) -> dict[str, Any]:
        """The service's health with that of the loop."""
        return self.service.health() | {
            "loop": {
                "errors": self._guard.errors,
                "dropped": self.inbox.dropped,
                **self._latency.told("latency"),
            }
        }

    def close(self) -> None:
        """Withdraws everything from the network; the session stays its owner's."""
        self._token.undeclare()
        for entity in (*self._entities, *self._publishers.values()):
            entity.undeclare()
