"""Asking everybody who answers at a key, and believing the one who proves to be the gate."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import zenoh

from twin_daemon.services.stop_report import UNPROVED

Proves = Callable[[bytes, bytes | None], bool]
URGENT: dict[str, Any] = {
    "congestion_control": zenoh.CongestionControl.BLOCK,
    "priority": zenoh.Priority.REAL_TIME,
    "express": True,
}
"""How a stop goes: it is not dropped on a link that is full, and passes what waits there."""


def ask_everybody(
    session: zenoh.Session,
    key: str,
    payload: bytes,
    proof: bytes | None,
    timeout_s: float,
    proves: Proves | None,
    urgent: bool = False,
) -> dict[str, Any] | None:
    """The JSON object of the first reply that `proves` holds for, with `proved`; else the first one that came; None
    where nobody answered. Without `proves` the first reply is as good as any.

    All who serve the key are asked: one who claims to serve it must not keep the request from the gate.
    """
    unproved = None
    replies = session.get(
        key,
        payload=payload,
        attachment=proof,
        timeout=timeout_s,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        **(URGENT if urgent else {}),
    )
    for reply in replies:
        if reply.ok is None:
            continue
        content = reply.ok.payload.to_bytes()
        told = json_object(content)
        if told is None:
            continue
        attached = reply.ok.attachment
        if proves is not None and proves(content, None if attached is None else attached.to_bytes()):
            return told | {"proved": True}
        unproved = unproved or told | {"proved": False}
        if proves is None:
            break
    return unproved


def json_object(content: bytes) -> dict[str, Any] | None:
    """The JSON object in these bytes; None where there is none."""
    try:
        told = json.loads(content)
    except (ValueError, RecursionError):
        return None
    return told if isinstance(told, dict) else None


def believed(answer: dict[str, Any]) -> dict[str, Any]:
    """An answer as it counts to one who has a key: "accepted" is worth nothing where it is not proved."""
    if answer.get("proved") or answer.get("accepted") is not True:
        return answer
    return answer | {
        "accepted": False,
        "check": "unproved",
        "why": UNPROVED,
        "allowed": "the same keys here and at the gate",
        "consequence": "nobody knows whether it was done",
    }
