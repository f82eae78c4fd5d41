"""The stop of the hand's own driver, where its description names one: called with every stop of the gate."""

from __future__ import annotations

import json
import time
from typing import Any

import zenoh

from bridges.zenoh.asking import json_object
from twin_daemon.hand import HandDescription

_PATIENCE_S = 2.0
_AGAIN_S = 1.0  # stops that come faster are one


class DriverStop:
    """Calls it without waiting; `told` says what came of it. A key is put to; a ROS 2 service is called by the bridge
    (`twin bridge ros2`), which is asked at the key `driver_stop`."""

    def __init__(self, session: zenoh.Session, description: HandDescription) -> None:
        self._session = session
        self._stop = description.stop
        self._key = description.key("driver_stop")
        self._called_s = -_AGAIN_S
        self._outcome: tuple[bool | None, str | None] = (None, None)

    def call(self) -> None:
        """Raises ZError where the network is closed."""
        stop, now_s = self._stop, time.monotonic()
        if stop is None or now_s - self._called_s < _AGAIN_S:
            return
        self._called_s, self._outcome = now_s, (None, None)
        if stop.zenoh_key is not None:
            self._session.put(
                stop.zenoh_key,
                stop.zenoh_payload,
                priority=zenoh.Priority.REAL_TIME,
                congestion_control=zenoh.CongestionControl.BLOCK,
                express=True,
            )
        if stop.ros_service is not None:
            answers = zenoh.handlers.Callback(self._heard, self._ended)
            self._session.get(self._key, answers, timeout=_PATIENCE_S, target=zenoh.QueryTarget.ALL)

    def _heard(self, reply: zenoh.Reply) -> None:
        told = json_object(reply.ok.payload.to_bytes()) if reply.ok is not None else None
        if told is not None:
            self._outcome = told.get("done") is True, str(told.get("why") or "")[:300] or None

    def _ended(self) -> None:
        if self._outcome[0] is None:
            self._outcome = False, "no bridge answered: is 'twin bridge ros2' running?"

    def told(self) -> dict[str, Any] | None:
        """`what` was called last and whether it is `done` (None: put, or no answer yet), with `why` not. None where
        nothing was called."""
        if self._stop is None or self._called_s < 0.0:
            return None
        done, why = self._outcome
        if self._stop.ros_service is None:
            done = True  # a put has no answer: that the hand rests is measured
        return {"what": self._stop.in_words(), "done": done, "why": why}


def answered(done: bool, why: str | None) -> bytes:
    """The bridge's answer."""
    return json.dumps({"schema": 1, "done": done, "why": why}).encode()
