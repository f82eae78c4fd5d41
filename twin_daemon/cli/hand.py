"""`twin hand`: a stand-in for the real hand."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.console import people, plain_text, require_folder
from twin_daemon.cli.options import Endpoint, HandName, Model, Namespace, Seconds, Seed
from twin_daemon.cli.run import load_named
from twin_daemon.errors import BadInput, UsageError

if TYPE_CHECKING:
    from twin_daemon.hand import Hand
    from twin_daemon.plant import Plant
    from twin_daemon.signals.trajectory import Trajectory

log = logging.getLogger("twin.hand")
_USUAL_MOTION = "rich_hand"


def command(
    hidden: Annotated[
        list[str] | None,
        typer.Option("--hidden", metavar="KEY[:joint][=value]...", help="Effects that the twin is not told of."),
    ] = None,
    trajectory: Annotated[
        str | None,
        typer.Option(
            "--trajectory",
            metavar="NAME",
            help="Its own motion, repeated; 'none': it waits for commands; with --output also slow_closing.",
        ),
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", metavar="HZ", min=1.0, max=1000.0, help="Joint states a second.")
    ] = None,
    spread: Annotated[
        float, typer.Option("--spread", metavar="0..1", help="How far its parameters lie from the nominal model's.")
    ] = 0.2,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE.mcap", help="Write a recording at once instead of going live."),
    ] = None,
    joint: Annotated[
        list[str] | None,
        typer.Option("--joint", metavar="J...", help="With --output: which joints move richly; default all."),
    ] = None,
    take: Annotated[
        int, typer.Option("--take", metavar="N", min=0, help="With --output: another rich motion of the same hand.")
    ] = 0,
    fault: Annotated[
        list[str] | None,
        typer.Option("--fault", metavar="KIND[:joint]...", help="Faults of its readings: degrees, dead, reversed."),
    ] = None,
    seed: Seed = 0,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    seconds: Seconds = None,
) -> int:
    """A simulated hand in place of the real one, with wear and hidden effects. It moves until it is commanded.

    With --output it needs no network and no time: it writes what the bus would have carried as a ROS 2 bag.
    """
    from bridges.zenoh.connection import Connection
    from bridges.zenoh.session import choose_endpoint
    from bridges.zenoh.stand_in import StandIn
    from twin_daemon.plant import Faulty, Plant, parse_fault, parse_hidden
    from twin_daemon.services.stop import on_termination

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    chosen = load_named(hand, model, namespace)
    effects = [parse_hidden(text, chosen) for text in hidden or []]
    faults = [parse_fault(text, chosen) for text in fault or []]
    plant = Plant(chosen, seed=seed, hidden=effects, spread=spread)
    if output is not None and faults:
        raise UsageError("--fault is for a live hand", todo="Leave --output away")
    if output is not None:
        write_recording(plant, trajectory, joint or [], output, seconds or 30.0, rate, take)
        return 0
    if joint:
        raise UsageError("--joint chooses what moves in a recording", todo="Give --output as well, or a --trajectory")
    motion = own_motion(chosen, trajectory)
    stand_in = StandIn(Faulty(plant, faults), chosen.description, rate or chosen.description.rate_hz, motion)
    address = choose_endpoint(endpoint)
    with on_termination() as stop, Connection(address) as connection:
        log.info(
            "the stand-in of %s looks for the twin at %s; it %s",
            chosen.description.namespace,
            address,
            "waits for commands" if motion is None else f"repeats {motion.name}",
        )
        stand_in.run(connection, stop, seconds)
    done = stand_in.counts
    log.info(
        "the stand-in has stopped: %d joint states and %d commands sent, %d commands of others followed",
        done.joint_states,
        done.own_commands,
        done.followed_commands,
    )
    return 0


def write_recording(
    plant: Plant,
    reference: str | None,
    joints: Sequence[str],
    output: Path,
    seconds: float,
    rate: float | None,
    take: int,
) -> None:
    """Runs the plant through a trajectory, or a rich motion of the joints (all if none), into a new MCAP file."""
    from twin_daemon.plant.motions import rich, slow_closing
    from twin_daemon.plant.recording import record
    from twin_daemon.signals.trajectory import load_trajectory

    require_folder(output)
    if output.exists():
        raise BadInput("the file exists, and a recording is never written over", where=output, todo="Name another one")
    if output.suffix != ".mcap":
        raise UsageError(f"'{output.name}' is not an MCAP file", allowed="a name that ends in .mcap")
    if reference is not None and joints:
        raise UsageError("--trajectory and --joint exclude each other", todo="Give one of them")
    if reference is None:
        motion = rich(plant.hand, joints, seconds, take)
    elif reference == slow_closing.__name__:
        motion = slow_closing(plant.hand)
    else:
        motion = load_trajectory(reference, plant.hand)
    run = record(plant, motion, output, rate_hz=rate, jitter_s=0.0005, seed=take)
    people().print(f"{len(run.time_s)} joint states over {run.time_s[-1]:.1f} s written to {plain_text(output)}")


def own_motion(hand: Hand, reference: str | None) -> Trajectory | None:
    """What the hand does by itself: the trajectory asked for, else a rich one of its own, else an easy one."""
    from bridges.zenoh.stand_in import easy_motion, holding_the_rest
    from twin_daemon.signals.trajectory import load_trajectory

    if reference == "none":
        return None
    if reference is not None:
        return holding_the_rest(load_trajectory(reference, hand).by_command(hand), hand)
    try:
        return holding_the_rest(load_trajectory(_USUAL_MOTION, hand).by_command(hand), hand)
    except BadInput:  # it is another hand's
        return easy_motion(hand)
