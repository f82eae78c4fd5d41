"""`twin hand`: a stand-in for the real hand."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.options import HandName, Model, Seconds, Seed
from twin_daemon.cli.run import Endpoint, Namespace, load_named
from twin_daemon.errors import BadInput

if TYPE_CHECKING:
    from twin_daemon.hand import Hand
    from twin_daemon.signals.trajectory import Trajectory

log = logging.getLogger("twin.hand")
_USUAL_MOTION = "rich_hand"


def command(
    hidden: Annotated[
        list[str] | None,
        typer.Option("--hidden", metavar="KEY[:joint][=value]...", help="Effects that the hand has and nobody knows."),
    ] = None,
    trajectory: Annotated[
        str | None,
        typer.Option("--trajectory", metavar="NAME", help="Its own motion, repeated; 'none': it waits for commands."),
    ] = None,
    rate: Annotated[
        float | None, typer.Option("--rate", metavar="HZ", min=1.0, max=1000.0, help="Joint states a second.")
    ] = None,
    spread: Annotated[
        float, typer.Option("--spread", metavar="0..1", help="How far its parameters lie from the nominal model's.")
    ] = 0.2,
    seed: Seed = 0,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    seconds: Seconds = None,
) -> int:
    """A stand-in for the real hand, worn as you like, that moves by itself until somebody commands it."""
    from bridges.connection import Connection
    from bridges.session import choose_endpoint
    from bridges.stand_in import StandIn
    from bridges.stop import on_termination
    from twin_daemon.plant import Plant, parse_hidden

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    chosen = load_named(hand, model, namespace)
    effects = [parse_hidden(text, chosen) for text in hidden or []]
    plant = Plant(chosen, seed=seed, hidden=effects, spread=spread)
    motion = own_motion(chosen, trajectory)
    stand_in = StandIn(plant, chosen.description, rate or chosen.description.rate_hz, motion)
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


def own_motion(hand: Hand, reference: str | None) -> Trajectory | None:
    """What the hand does by itself: the trajectory asked for, else a rich one of its own, else an easy one."""
    from bridges.stand_in import easy_motion, holding_the_rest
    from twin_daemon.signals.trajectory import load_trajectory

    if reference == "none":
        return None
    if reference is not None:
        return holding_the_rest(load_trajectory(reference, hand).by_command(hand), hand)
    try:
        return holding_the_rest(load_trajectory(_USUAL_MOTION, hand).by_command(hand), hand)
    except BadInput:  # it is another hand's
        return easy_motion(hand)
