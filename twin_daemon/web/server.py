"""Runs the application on a socket until it is asked to stop."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette

from twin_daemon.daemon.notify import Notifier
from twin_daemon.errors import BadInput

_GRACE_S = 3  # for answers that are on their way when the server stops


def listen(address: str, port: int) -> socket.socket:
    """A listening socket; port 0 is any free one. Raises BadInput where it cannot be had."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        listener = socket.create_server((address, port), family=family)
    except OSError as error:
        raise BadInput(
            f"cannot listen ({error.strerror or error})",
            where=f"{address}:{port}",
            todo="Choose another --port or --bind",
        ) from None
    # the body of an answer does not wait until its head was acknowledged, which costs 40 ms each time; asyncio sees
    # to this only for sockets that it has made itself
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def serve(app: Starlette, listener: socket.socket, seconds: float | None, ready: Callable[[], None]) -> None:
    """Serves until SIGTERM, SIGINT, or so many seconds have passed. `ready` is called when requests are answered; the
    service manager is told then too, and while the loop turns."""
    config = uvicorn.Config(
        app,
        log_level="warning",
        access_log=False,
        ws="websockets-sansio",
        ws_max_size=4096,  # the page says nothing on its stream
        timeout_graceful_shutdown=_GRACE_S,
        server_header=False,
        lifespan="on",
    )
    server = _Server(config, ready)
    timer = threading.Timer(seconds, server.end) if seconds is not None else None
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        server.run(sockets=[listener])
    finally:
        if timer is not None:
            timer.cancel()
        listener.close()


class _Server(uvicorn.Server):
    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._ready = ready
        self._notifier = Notifier()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._ready()
            self._notifier.say("READY=1")

    async def on_tick(self, counter: int) -> bool:
        self._notifier.alive()
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._notifier.say("STOPPING=1")
        await super().shutdown(sockets)

    def end(self) -> None:
        self.should_exit = True
