"""`twin bridge`: the twin joined with a ROS 2 system, or shown in Foxglove."""

from __future__ import annotations

import logging
import time
from typing import Annotated, Any

import typer

from twin_daemon.cli.command import Group, TwinCommand
from twin_daemon.cli.options import Bind, Endpoint, HandName, Model, Namespace, Seconds
from twin_daemon.cli.run import load_named

ROS_ARGS = "--ros-args"
FOXGLOVE_PORT = 8765  # where Foxglove looks by itself
_TELL_EVERY_S = 5.0
_TURN_S = 0.1
log = logging.getLogger("twin.bridge")
app = Group(help="Join the twin and another middleware.")


class _WithRosArgs(TwinCommand):
    """Leaves --ros-args and everything after it to ROS."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        begin = args.index(ROS_ARGS) if ROS_ARGS in args else len(args)
        super().parse_args(ctx, args[:begin])
        ctx.args = args[begin:]
        return ctx.args


@app.command("ros2", cls=_WithRosArgs, epilog="Everything after --ros-args goes to ROS: -r, -p and the like.")
def ros2(
    ctx: typer.Context,
    hand: HandName = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    seconds: Seconds = None,
) -> int:
    """Join a ROS 2 system and the twin: joint states and commands in, prediction, residual and diagnostics out."""
    from bridges.ros2.presence import require_ros
    from twin_daemon.services.stop import on_termination

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    chosen = {"hand": hand, "namespace": namespace, "endpoint": endpoint}
    given = {name: value for name, value in chosen.items() if value is not None}
    with on_termination() as stop:  # from here on: loading ROS takes a second
        require_ros()
        from bridges.ros2.run import run

        counts = run(given, ctx.args, stop, seconds)
    log.info(
        "the bridge has stopped: %d joint states forwarded, %d predictions published, %d errors",
        counts.get("joint_states.forwarded", 0),
        counts.get("twin_joint_states.published", 0),
        counts["errors"],
    )
    return 0


@app.command("foxglove")
def foxglove(
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    port: Annotated[
        int, typer.Option("--port", metavar="N", min=0, max=65535, help="Port to serve at; 0 takes any free one.")
    ] = FOXGLOVE_PORT,
    bind: Bind = "127.0.0.1",
    seconds: Seconds = None,
) -> int:
    """Serve measured, commanded, predicted and residual joints, events, health and the model to Foxglove, live.

    Viewers see and move nothing. What is served is neither encrypted nor asked for a token: leave it on loopback.
    """
    from bridges.foxglove.bridge import FoxgloveBridge, require_foxglove
    from bridges.zenoh.client import ask
    from bridges.zenoh.connection import Connection
    from bridges.zenoh.listening import listening
    from bridges.zenoh.session import choose_endpoint
    from twin_daemon.errors import NoAnswer, TwinError
    from twin_daemon.services.stop import on_termination

    require_foxglove()
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    description = load_named(hand, model, namespace).description
    address = choose_endpoint(endpoint)
    end_s = float("inf") if seconds is None else time.monotonic() + seconds
    with on_termination() as stop, Connection(address) as connection:
        while not connection.wait(_TURN_S):
            if stop.is_set() or time.monotonic() >= end_s:
                raise NoAnswer(f"nothing listens at {address}", todo="Start the daemon with 'twin run'")
        session = connection.session
        assert session is not None

        def answer(question: str) -> dict[str, Any] | None:
            try:
                return ask(session, description.key(question), 1.0)
            except TwinError:
                return None

        bridge = FoxgloveBridge(listening(session), answer, description, bind, port)
        try:
            log.info("Foxglove opens ws://%s:%d", bind, bridge.port)
            next_s = time.monotonic()
            while not stop.is_set() and time.monotonic() < end_s:
                if time.monotonic() >= next_s:
                    next_s = time.monotonic() + _TELL_EVERY_S
                    bridge.tell_model()
                stop.wait(_TURN_S)
        finally:
            bridge.close()
    log.info("the bridge has stopped: %s", ", ".join(f"{n} {name}" for name, n in sorted(bridge.counts.items())))
    return 0
