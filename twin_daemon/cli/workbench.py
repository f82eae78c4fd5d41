"""`twin workbench`: the page on which people see hand and twin, and work on what the model lacks."""

from __future__ import annotations

import logging
import socket
from typing import Annotated

import typer

from twin_daemon.cli import options
from twin_daemon.cli.console import people, plain_text
from twin_daemon.cli.run import Endpoint, Namespace, load_named
from twin_daemon.cli.session import silence_mujoco

PORT = 8460

Port = Annotated[
    int, typer.Option("--port", metavar="N", min=0, max=65535, help="Where the page is served; 0: any free port.")
]
Bind = Annotated[
    str, typer.Option("--bind", metavar="ADDRESS", help="Address to listen at; others than loopback are reachable.")
]
Names = Annotated[
    list[str] | None,
    typer.Option("--name", metavar="HOST...", help="Further names under which browsers may ask this server."),
]


def command(
    port: Port = PORT,
    bind: Bind = "127.0.0.1",
    name: Names = None,
    hand: options.HandName = None,
    model: options.Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    seconds: options.Seconds = None,
) -> int:
    """Serve the workbench: live hand and twin, recordings against versions, diagnosis, ladder, history.

    It reads only, until the page is opened with the token of the address that is printed at the start.
    """
    from bridges.session import choose_endpoint
    from bridges.stop import on_termination
    from workbench.allowance import LOOPBACK, new_token
    from workbench.app import build
    from workbench.live import Live
    from workbench.server import listen, serve

    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(levelname)s %(message)s")
    chosen = load_named(hand, model, namespace)
    live = Live(chosen.description, choose_endpoint(endpoint))
    silence_mujoco()
    listener = listen(bind, port)
    token = new_token()
    shown = f"[{bind}]" if ":" in bind else bind
    hosts = {*LOOPBACK, shown, socket.gethostname(), *(name or [])}
    app = build(chosen, live, token, hosts)
    address = f"http://{shown}:{listener.getsockname()[1]}/"

    def ready() -> None:
        console = people()
        console.print(f"The workbench of {plain_text(chosen.description.namespace)}:", soft_wrap=True)
        console.print(f"  to look:  {plain_text(address)}", soft_wrap=True)
        console.print(f"  to work:  {plain_text(address)}#token={token}", soft_wrap=True)
        console.file.flush()

    with on_termination():
        serve(app, listener, seconds, ready)
    return 0
