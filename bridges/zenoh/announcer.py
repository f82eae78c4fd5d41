"""Motion that begins by itself, told to everybody, and cancelled by anybody."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable
from typing import Any

import zenoh

from twin_daemon.daemon.automatic import NOTHING
from twin_daemon.hand import HandDescription
from twin_daemon.services.guard import Guard

log = logging.getLogger("twin")

Cancel = Callable[[str], bool]
_MOST_REASON = 200


class Announcer:
    """Publishes `announcement` for lamps, buzzers and pages: while something comes or moves at each call, and once
    that it is over. `command/cancel` is asked or put, in any form and by anybody: there is nothing to prove."""

    def __init__(self, session: zenoh.Session, description: HandDescription, cancel: Cancel) -> None:
        self._cancel = cancel
        self._guard = Guard(log)
        self._phase = "none"
        self._publisher = session.declare_publisher(
            description.key("announcement"),
            encoding="application/json",
            congestion_control=zenoh.CongestionControl.DROP,
        )
        key = description.key("command", verb="cancel")
        self._entities: list[Any] = [
            session.declare_queryable(key, self._asked),
            session.declare_subscriber(key, self._put),
        ]

    def tell(self, told: dict[str, Any] | None) -> None:
        """What comes or moves; None for nothing."""
        now = told or NOTHING
        if told is not None or self._phase != "none":
            self._publisher.put(json.dumps(now, allow_nan=False))
        self._phase = now["phase"]

    def _asked(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        with query:
            if "*" not in key:  # to ask for everything is to look
                self._guard.run("a cancel", lambda: query.reply(key, json.dumps(self._cancelled(query.payload))))

    def _put(self, sample: zenoh.Sample) -> None:
        self._guard.run("a cancel", self._cancelled, sample.payload)

    def _cancelled(self, payload: zenoh.ZBytes | None) -> dict[str, Any]:
        done = self._cancel(_reason(payload))
        why = "cancelled; what moved comes to rest" if done else "no automatic motion is announced or under way"
        return {"schema": 1, "verb": "cancel", "accepted": True, "cancelled": done, "why": why}

    def close(self) -> None:
        self.tell(None)
        for entity in (*self._entities, self._publisher):
            entity.undeclare()


def _reason(payload: zenoh.ZBytes | None) -> str:
    """The reason of a request, or plain text; "" where there is none that can be read."""
    data = b"" if payload is None else payload.to_bytes()[: 20 * _MOST_REASON]
    try:
        told = json.loads(data)
    except (ValueError, RecursionError):
        told = data.decode(errors="replace")
    reason = told.get("reason") if isinstance(told, dict) else told
    return " ".join(str(reason or "").split())[:_MOST_REASON]
