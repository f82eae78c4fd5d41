"""The Foxglove bridge's log panel: what matters stands out."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from bridges.foxglove.bridge import EVENTS, FoxgloveBridge
from twin_daemon.hand import load_hand

pytest.importorskip("foxglove", reason="the extra 'foxglove' is not installed")
INFO, WARNING, ERROR = 2, 3, 4


def logged(socket: ClientConnection, kind: str, say: Callable[[bytes], None]) -> int:
    """The level that an event's log message has: its second field, after the time stamp."""
    event = json.dumps({"kind": kind, "text": "rh_FFJ3", "stamp_ns": 1_700_000_000_000_000_001}).encode()
    for _ in range(50):
        say(event)  # more than once: a subscription takes a moment to count
        with suppress(TimeoutError):
            while not isinstance(told := socket.recv(timeout=0.2), bytes) or kind.encode() not in told:
                pass
            message = told[13:]  # after the kind, the subscription and the time
            assert (message[0], message[2 + message[1]]) == (0x0A, 0x10)
            return message[3 + message[1]]
    raise AssertionError(f"{kind} was not logged")


def test_a_change_warns_and_an_alarm_stands_out() -> None:
    heard: dict[str, Callable[[bytes], None]] = {}

    def listen(key: str, hears: Callable[[bytes], None]) -> Callable[[], None]:
        heard[key] = hears
        return lambda: None

    description = load_hand().description
    bridge = FoxgloveBridge(listen, lambda _: None, description, "127.0.0.1", 0)
    try:
        address = f"ws://127.0.0.1:{bridge.port}"
        with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as socket:
            number = None
            while number is None:
                told = socket.recv(timeout=10.0)
                if isinstance(told, str) and (found := json.loads(told))["op"] == "advertise":
                    number = next((one["id"] for one in found["channels"] if one["topic"] == EVENTS), None)
            socket.send(json.dumps({"op": "subscribe", "subscriptions": [{"id": 0, "channelId": number}]}))
            say = heard[description.key("events")]
            levels = {kind: logged(socket, kind, say) for kind in ("version", "drift", "changed", "alarm")}
    finally:
        bridge.close()
    assert levels == {"version": INFO, "drift": WARNING, "changed": WARNING, "alarm": ERROR}
