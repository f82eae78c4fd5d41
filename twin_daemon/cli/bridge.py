"""`twin bridge ros2`: a ROS 2 system and the twin, joined."""

from __future__ import annotations

import logging
from typing import Any

import typer

from twin_daemon.cli.command import Group, TwinCommand
from twin_daemon.cli.options import Endpoint, HandName, Namespace, Seconds

ROS_ARGS = "--ros-args"
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
