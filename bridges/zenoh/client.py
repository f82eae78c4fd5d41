"""Asking a daemon a question over Zenoh."""

from __future__ import annotations

import json
import time
from typing import Any

import zenoh

from bridges.zenoh.session import open_client
from twin_daemon.errors import BadInput, NoAnswer

_BETWEEN_TRIES_S = 0.05


def connect(endpoint: str, timeout_s: float, name: str = "") -> zenoh.Session:
    """A session with the daemon at `endpoint`, in the name of an identity. Raises NoAnswer when nobody is there."""
    session = open_client(endpoint, timeout_s, name=name)
    if session is None:
        raise NoAnswer(f"nothing answered at {endpoint}", todo="Start the daemon with 'twin run'")
    return session


def ask(session: zenoh.Session, key: str, timeout_s: float = 3.0) -> dict[str, Any]:
    """The JSON object that answers `key`. Asks again until someone does; raises NoAnswer after `timeout_s`."""
    deadline_s = time.monotonic() + timeout_s
    while True:
        left_s = max(deadline_s - time.monotonic(), 0.05)
        for reply in session.get(key, timeout=left_s):
            if reply.ok is not None:
                return json.loads(reply.ok.payload.to_bytes())
            if reply.err is not None and reply.err.payload.to_bytes().startswith(b"{"):
                raise BadInput(json.loads(reply.err.payload.to_bytes())["error"], todo="See 'twin versions list'")
        if time.monotonic() >= deadline_s:
            raise NoAnswer(f"nothing answered at {key}", todo="Is 'twin run' running? Same --hand, same --endpoint?")
        time.sleep(_BETWEEN_TRIES_S)


def ask_once(endpoint: str, key: str, timeout_s: float = 3.0) -> dict[str, Any]:
    """Connects, asks, and leaves. Raises NoAnswer when nobody is there."""
    begin_s = time.monotonic()
    with connect(endpoint, timeout_s) as session:
        return ask(session, key, max(timeout_s - (time.monotonic() - begin_s), 0.1))
