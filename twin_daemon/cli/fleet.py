"""`twin fleet`: the hands of one network."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Endpoint, Json
from twin_daemon.errors import NoAnswer

if TYPE_CHECKING:
    from rich.table import Table

    from bridges.zenoh.fleet import HandSeen

Seconds = Annotated[
    float, typer.Option("--seconds", metavar="S", min=0.1, help="How long to look; it ends once all have answered.")
]


def command(endpoint: Endpoint = None, seconds: Seconds = 3.0, json: Json = None) -> int:
    """Which hands are on this network, and how each is. Exit code 5 when none answers."""
    from bridges.zenoh.client import connect
    from bridges.zenoh.fleet import SILENT, find_hands
    from bridges.zenoh.session import choose_endpoint

    address = choose_endpoint(endpoint)
    with connect(address, seconds) as session:
        hands = find_hands(session, seconds)
    if all(one.status == SILENT for one in hands.values()):
        raise NoAnswer(
            f"{len(hands)} hands are there, and none answers" if hands else "no hand is there",
            where=address,
            todo="Start a daemon for each with 'twin run', a --namespace of its own and this --endpoint",
        )
    if json != "-":
        people().print(_table(address, hands))
    emit_json(json, {"endpoint": address, "hands": {namespace: asdict(one) for namespace, one in hands.items()}})
    return 0


def _table(address: str, hands: dict[str, HandSeen]) -> Table:
    from twin_daemon.tables import slim_table

    headings = ("namespace", "hand, version", "state, age", "drift", "worst joint, rms", "gate")
    table = slim_table(f"Hands at {address}", headings, words=headings[1:])
    for namespace, one in hands.items():
        cells = (
            namespace,
            f"{one.hand or '-'} {(one.version or '')[:10]}",
            f"{one.status} {'' if one.age_s is None else f'{one.age_s:.3f} s'}",
            f"{one.drift or '-'} {', '.join(one.drifting_joints)}",
            "-" if one.worst_rmse_rad is None else f"{one.worst_joint} {1e3 * one.worst_rmse_rad:.2f} mrad",
            one.gate or "-",
        )
        table.add_row(*(plain_text(cell.strip()) for cell in cells))
    return table
