"""`twin command`: commands to the real hand, through the gate."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.command import Group
from twin_daemon.cli.commanding import accepted, body_of, follow_motion, gate_connection
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.leases import keep_lease, lease_file
from twin_daemon.cli.options import As, Endpoint, HandName, Json, Model, Namespace, Reason
from twin_daemon.cli.run import load_named
from twin_daemon.errors import Refused, UsageError
from twin_daemon.workflows.progress import progress_console

if TYPE_CHECKING:
    from pathlib import Path

    from twin_daemon.cli.commanding import GateConnection
    from twin_daemon.hand import HandDescription

app = Group("Commands to the real hand, through a gate that checks them. It is no certified stop.")

DryRun = Annotated[bool, typer.Option("--dry-run", help="Try it on the twin only, and say what would happen.")]
_OPERATOR = "operator"


def _at(
    hand: str | None, model: Path | None, namespace: str | None, endpoint: str | None
) -> tuple[HandDescription, str]:
    """(the hand's description, where its router listens)."""
    from bridges.zenoh.session import choose_endpoint

    return load_named(hand, model, namespace).description, choose_endpoint(endpoint)


@app.command("arm")
def arm(
    reason: Reason = "",
    lease: Annotated[float | None, typer.Option("--lease", metavar="S", min=0.1, help="How long it may last.")] = None,
    renew: Annotated[bool, typer.Option("--renew", help="Go on with the lease that you armed before.")] = False,
    name: As = _OPERATOR,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Let commands through, for a reason and for a time. One commander at once, in one session: another one in the
    same name waits until the lease ends. The 'twin command's that follow share it."""
    with gate_connection(hand, model, namespace, endpoint, name, with_lease=renew) as connection:
        answer = connection.commander.ask("arm", reason=reason, **({} if lease is None else {"lease_s": lease}))
        if answer["accepted"]:
            keep_lease(lease_file(connection.hand.description.namespace, name), connection.commander.lease)
    left_s = answer["gate"]["lease_left_s"] if answer["accepted"] else 0.0
    _tell(answer, json, "\n".join([f"armed for {left_s or 0.0:.0f} s", *answer.get("warnings", [])]))


@app.command("disarm")
def disarm(
    name: As = _OPERATOR,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """End the lease. What moves comes to rest; the hand holds."""
    with gate_connection(hand, model, namespace, endpoint, name, with_lease=True) as connection:
        answer = connection.commander.ask("disarm")
    _tell(answer, json, "disarmed; the hand holds where it is")


@app.command("move")
def move(
    targets: Annotated[list[str], typer.Argument(metavar="NAME=RAD...", help="Joints or commands and their targets.")],
    seconds: Annotated[
        float | None, typer.Option("--seconds", metavar="S", min=0.01, help="How long it takes.")
    ] = None,
    dry_run: DryRun = False,
    name: As = _OPERATOR,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Move some joints smoothly to their targets, and wait until they are there. Ctrl-C ends the motion."""
    body: dict[str, Any] = {"targets": _targets(targets), "dry_run": dry_run}
    with gate_connection(hand, model, namespace, endpoint, name, with_lease=True) as connection:
        _motion(connection, "move", body | ({} if seconds is None else {"seconds": seconds}), json)


@app.command("trajectory")
def trajectory(
    reference: Annotated[str, typer.Argument(metavar="NAME|FILE.yaml:NAME", help="Which trajectory.")],
    dry_run: DryRun = False,
    name: As = _OPERATOR,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Go smoothly to the start of a trajectory, then along it. Ctrl-C ends the motion."""
    from twin_daemon.signals.trajectory import load_trajectory

    plan = load_trajectory(reference, load_named(hand, model, namespace))
    with gate_connection(hand, model, namespace, endpoint, name, with_lease=True) as connection:
        _motion(connection, "trajectory", {**body_of(plan.by_command(connection.hand)), "dry_run": dry_run}, json)


@app.command("stop")
def stop(
    reason: Reason = "",
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Bring everything to rest and latch it: nothing is armed again before 'release'. Anybody may do it.

    Says after a second whether the hand still moves. Ends with 4 where it does, or where no gate proves to be stopped.
    """
    from bridges.zenoh.commander import who_stops
    from bridges.zenoh.session import open_client
    from twin_daemon.errors import NoAnswer
    from twin_daemon.services.stop_report import OWN_STOP, in_words, is_safe

    description, address = _at(hand, model, namespace, endpoint)
    session = open_client(address, 5.0)
    if session is None:
        raise NoAnswer(f"nothing answered at {address}: NOT stopped", todo=OWN_STOP)
    with session:
        try:
            report = who_stops(session, description).stop(reason)
        except NoAnswer as error:
            raise NoAnswer(f"{error.what}: NOT stopped", todo=OWN_STOP) from None
    emit_json(json, report)
    if not is_safe(report):
        raise Refused(in_words(report))
    people(json).print(f"{in_words(report)}. 'twin command release' undoes it")


@app.command("cancel")
def cancel(
    reason: Reason = "",
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Cancel a motion that the twin is about to begin by itself, or has begun. Anybody may do it."""
    from bridges.zenoh.client import connect
    from bridges.zenoh.commander import cancel_automatic

    description, address = _at(hand, model, namespace, endpoint)
    with connect(address, 5.0) as session:
        answer = cancel_automatic(session, description, reason or "twin command cancel")
    _tell(answer, json, str(answer["why"]))


@app.command("release")
def release(
    reason: Reason = "",
    name: As = _OPERATOR,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Undo a stop. The hand is not armed by it."""
    with gate_connection(hand, model, namespace, endpoint, name) as connection:
        answer = connection.commander.ask("release", reason=reason)
    _tell(answer, json, "released; not armed")


@app.command("status")
def status(
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: Json = None,
) -> None:
    """Who has armed the hand, for how long, and what moves."""
    from bridges.zenoh.client import ask_once

    description, address = _at(hand, model, namespace, endpoint)
    found = ask_once(address, description.key("command", verb="status"))
    if json != "-":
        for key, value in found.items():
            people().print(f"{key}: {plain_text('-' if value is None else value)}")
    emit_json(json, found)


def _targets(pairs: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for pair in pairs:
        joint, equals, value = pair.partition("=")
        try:
            found[joint] = float(value)
        except ValueError:
            equals = ""
        if not (joint and equals):
            raise UsageError(f"'{pair}' is not NAME=RAD", todo="Write rh_FFJ3=0.5")
    return found


def _motion(connection: GateConnection, verb: str, body: dict[str, Any], json: str | None) -> None:
    from twin_daemon.services.stop import on_termination

    with on_termination() as stop:
        answer = connection.commander.ask(verb, **body)
        if body["dry_run"]:
            emit_json(json, answer)
            accepted(answer)
            _show_rehearsal(answer["rehearsal"], json)
            return
        if not answer["accepted"]:
            emit_json(json, answer)
            accepted(answer)
        began_s = time.monotonic()
        console = progress_console()
        with console.status("moving") as line:
            status = follow_motion(
                connection, answer, stop, report=lambda at, of: line.update(f"{at:.1f} of {of:.1f} s")
            )
    emit_json(json, answer | {"gate": status})
    people(json).print(f"done in {time.monotonic() - began_s:.1f} s; the hand holds, and is still armed")


def _show_rehearsal(found: dict[str, Any], json: str | None) -> None:
    from twin_daemon.tables import slim_table

    console = people(json)
    table = slim_table("on the twin", ("command", "peak effort", "of what the motor can", "behind by rad"))
    for name, effort in found["peak_effort"].items():
        share = found["peak_effort_share"][name]
        table.add_row(
            plain_text(name),
            f"{effort:.3g}",
            "-" if share is None else f"{share:.0%}",
            f"{found['tracking_error_rad'][name]:.3f}",
        )
    console.print(table)
    touches = ", ".join(" and ".join(pair) for pair in found["touches"]) or "none"
    console.print(f"{found['duration_s']:.1f} s; bodies that touch: {plain_text(touches)}. The hand has not been moved")


def _tell(answer: dict[str, Any], json: str | None, done: str) -> None:
    emit_json(json, answer)
    accepted(answer)
    people(json).print(done)
