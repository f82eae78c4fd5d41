"""The gate's own subscription to its hand: it depends on nobody else to know where the joints are."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from typing import Any

import zenoh

from bridges.zenoh.ros_keys import RosKeys
from bridges.zenoh.sources import Sources
from bridges.zenoh.streams import heard_keys, subscriptions
from twin_daemon.daemon import cdr
from twin_daemon.daemon.gate_intake import GateIntake
from twin_daemon.daemon.messages import ROS_SOURCE, MalformedPayload
from twin_daemon.hand import HandDescription
from twin_daemon.services.guard import Guard

log = logging.getLogger("twin.gate")


class HandSubscriber:
    """Hears joint states and commands in the transport's thread, from the start until `close`."""

    def __init__(
        self, session: zenoh.Session, description: HandDescription, intake: GateIntake, ros: RosKeys | None = None
    ) -> None:
        self._intake = intake
        self._guard = Guard(log)
        self._sources = Sources(session)
        keys = [(heard_keys(description), ""), *([(ros.subscribed, ROS_SOURCE)] if ros is not None else [])]
        self._entities: list[Any] = [
            self._subscribe(session, expression, streams, by)
            for one, by in keys
            for expression, streams in subscriptions(one).items()
        ]

    def _subscribe(self, session: zenoh.Session, expression: str, streams: dict[str, str], by: str) -> Any:
        def heard(sample: zenoh.Sample) -> None:
            # a key with wildcards is that of a single stream
            stream = streams.get(expression) or streams.get(str(sample.key_expr))
            if stream is not None:
                self._guard.run(f"a message of {stream}", self._take, stream, sample, by, time.monotonic())

        return session.declare_subscriber(expression, heard)

    def _take(self, stream: str, sample: zenoh.Sample, by: str, now_s: float) -> None:
        try:
            message = replace(cdr.decode(sample.payload.to_bytes()), source=by + self._sources.of(sample))
        except MalformedPayload:  # the daemon counts them
            return
        (self._intake.on_joint_state if stream == "joint_states" else self._intake.on_command)(message, now_s)

    def close(self) -> None:
        for entity in self._entities:
            entity.undeclare()
