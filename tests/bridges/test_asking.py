"""A stop on a link that is full: it is not lost, and does not wait behind what was there before it."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest
import zenoh

from bridges.zenoh.commander import Commander
from bridges.zenoh.session import session_config
from tests.processes.conftest import until
from twin_daemon.cli.children import free_port
from twin_daemon.hand import load_hand

CHUNK, PAUSE_S = 16_384, 0.002  # at most 8 MB a second


@pytest.fixture
def narrow() -> Iterator[tuple[str, str]]:
    """Two endpoints: where to listen, and where to connect, with a slow link between them."""
    inner, outer = free_port(), free_port()
    ended = threading.Event()
    ears = socket.create_server(("127.0.0.1", outer))

    def passed_on(source: socket.socket, sink: socket.socket, slow: bool) -> None:
        while not ended.is_set() and (chunk := source.recv(CHUNK)):
            sink.sendall(chunk)
            if slow:
                ended.wait(PAUSE_S)

    def quietly(*arguments: Any) -> None:
        with contextlib.suppress(OSError):  # the other side has gone
            passed_on(*arguments)

    threads: list[threading.Thread] = []
    ends: list[socket.socket] = []

    def serve() -> None:
        client, _ = ears.accept()
        server = socket.create_connection(("127.0.0.1", inner))
        ends.extend([client, server])
        for one in ((client, server, True), (server, client, False)):
            threads.append(threading.Thread(target=quietly, args=one))
            threads[-1].start()

    ears.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, CHUNK)
    server = threading.Thread(target=serve)
    server.start()
    yield f"tcp/127.0.0.1:{inner}", f"tcp/127.0.0.1:{outer}"
    ended.set()
    server.join(10.0)
    for end in ends:
        with contextlib.suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()
    for thread in threads:
        thread.join(10.0)
    ears.close()


def test_a_stop_on_a_full_link_passes_what_waits_there(narrow: tuple[str, str]) -> None:
    listen, connect = narrow
    hand = load_hand().description
    put = arrived = asked = 0
    behind: list[int] = []
    ended = threading.Event()

    def hear(_: zenoh.Sample) -> None:
        nonlocal arrived
        arrived += 1

    def answer(query: zenoh.Query) -> None:
        behind.append(asked - arrived)
        with query:
            query.reply(str(query.key_expr), json.dumps({"accepted": True, "latched": True}))

    with zenoh.open(session_config("router", listen=[listen])) as router:
        entities = [router.declare_subscriber("flood", hear)]
        entities += [router.declare_queryable(hand.key("command", verb="*"), answer)]
        with zenoh.open(session_config("client", connect=[connect])) as client:

            def pour() -> None:
                nonlocal put
                while not ended.is_set():
                    client.put("flood", b"x" * 60_000, congestion_control=zenoh.CongestionControl.BLOCK)
                    put += 1

            thread = threading.Thread(target=pour)
            thread.start()
            try:
                until(lambda: arrived and put - arrived > 10, 30.0)  # so many wait on the way
                commander = Commander(client, hand)
                asked = put
                stop = threading.Thread(target=commander.stop, args=("now", 20.0))
                stop.start()
                until(lambda: behind, 20.0)
            finally:
                ended.set()
                thread.join(30.0)
            stop.join(30.0)
        for entity in entities:
            entity.undeclare()
    assert behind[0] >= 4, f"the stop waited until but {behind[0]} of the messages before it were still on their way"
