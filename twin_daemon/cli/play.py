"""`twin play`: recordings as if they were the hand."""

from __future__ import annotations

import logging
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.console import emit_json, people
from twin_daemon.cli.options import Endpoint, HandName, JointMap, Json, Model, Namespace, TrajectoryRef
from twin_daemon.cli.run import load_named

if TYPE_CHECKING:
    from twin_daemon.hand import Hand
    from twin_daemon.recordings import Recording
    from twin_daemon.recordings.recording import Commands

log = logging.getLogger("twin.play")


def command(
    recordings: Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="ROS 1 or 2 bags, MCAP, CSV.")],
    speed: Annotated[
        float, typer.Option("--speed", metavar="X", min=0.01, max=100.0, help="Speed, relative to real time.")
    ] = 1.0,
    loop: Annotated[bool, typer.Option("--loop", help="Repeat until it is stopped.")] = False,
    keep_stamps: Annotated[
        bool, typer.Option("--keep-stamps", help="Keep the recorded stamps instead of the present time.")
    ] = False,
    trajectory: TrajectoryRef = None,
    joint_map: JointMap = None,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> int:
    """Publish recordings in real time as if they were the hand, with the commands that they hold."""
    from bridges.zenoh.connection import Connection
    from bridges.zenoh.player import AHEAD_S, MOST_AHEAD_S, Timeline, play
    from bridges.zenoh.session import choose_endpoint
    from twin_daemon.recordings import load_joint_map, load_recording
    from twin_daemon.services.stop import on_termination

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    chosen = load_named(hand, model, namespace)
    renamed = load_joint_map(joint_map) if joint_map else None
    loaded = [load_recording(path, renamed) for path in recordings]
    ahead_ns = round(min(AHEAD_S * speed, MOST_AHEAD_S) * 1e9)
    timelines = [Timeline.of(one, commands_of(one, chosen, trajectory), ahead_ns) for one in loaded]
    address = choose_endpoint(endpoint)
    with on_termination() as stop, Connection(address) as connection:
        if not connection.wait(0.5):
            log.info("waiting for the twin at %s", address)
        played = play(timelines, chosen.description, connection, stop, speed=speed, loop=loop, keep_stamps=keep_stamps)
    if not played.listened:
        log.warning("nobody listened to %s", chosen.description.key("joint_states"))
    people(json).print(
        f"played {played.joint_states} joint states and {played.joint_commands} commands in {played.duration_s:.1f} s"
    )
    emit_json(json, {"recordings": [str(path) for path in recordings], "speed": speed, **asdict(played)})
    return 0


def commands_of(recording: Recording, hand: Hand, trajectory: str | None) -> Commands | None:
    """What the hand was told: as recorded, or a trajectory laid where the twin follows the measurement best."""
    import numpy as np

    from twin_daemon.recordings.recording import Commands

    if trajectory is None and (recording.commands is None or recording.commands.interpolation == "hold"):
        return recording.commands
    from twin_daemon.signals.trajectory import load_trajectory
    from twin_daemon.simulation.alignment import align, model_onset
    from twin_daemon.simulation.twin import TwinModel

    twin = TwinModel.load(hand)
    aligned = align(twin, recording, load_trajectory(trajectory, hand) if trajectory else None)
    onset_s = model_onset(twin, aligned) if aligned.onset_free else aligned.onset_s
    # each value is held until the next: taken from the middle of that time it is right on average
    half_s = 0.5 * float(np.median(np.diff(aligned.time_s)))
    position = aligned.signal.sample(aligned.time_s + half_s - onset_s)
    told = np.isfinite(position).any(axis=1)
    return Commands(recording.stamp_ns[told], aligned.signal.names, position[told], "hold")
