"""`twin recalibrate`: follow the wear of the hand, never for the worse."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.calibrate import Run, say_stored
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.cli.drive import drive
from twin_daemon.errors import UsageError
from twin_daemon.workflows.recalibration import recalibrated
from twin_daemon.workflows.session import open_session

if TYPE_CHECKING:
    from twin_daemon.recalibration.recalibrate import Recalibration


def command(
    recording: options.OptionalRecordings = None,
    run: Run = None,
    holdout: options.Holdouts = None,
    joints: options.Joints = None,
    within: Annotated[
        float | None,
        typer.Option(
            "--within",
            metavar="S",
            min=1.0,
            help="Use so many seconds of all cores, a diagnosis included.",
        ),
    ] = None,
    promote: Annotated[bool, typer.Option("--promote", help="Promote the result if it is better.")] = False,
    budget: options.Budget = None,
    seed: options.Seed = 0,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    name: options.As = "operator",
    namespace: options.Namespace = None,
    endpoint: options.Endpoint = None,
    json: options.Json = None,
) -> None:
    """Fit the version in use to what the hand does now, and decide whether the result is better.

    A Bayesian search around the version; where parameters alone do not explain the change, a diagnosis names the effect
    that has appeared. The result is stored as the candidate. Ctrl-C keeps the best so far.
    """
    require_folder(json)
    if not recording and run is None:
        raise UsageError("nothing to fit", todo="Give --recording R..., or --run NAME to drive the hand")
    session = open_session(hand, model, version=version, joint_map=joint_map)
    driven = [] if run is None else [drive(run, hand, model, namespace, endpoint, name)]
    train = session.recordings([*(recording or []), *driven], trajectory)
    held = session.recordings(holdout or [], trajectory)
    payload, found = recalibrated(session, train, held, joints or (), budget, within, seed, promote)
    _show(payload, found, json)
    emit_json(json, payload)


def _show(payload: dict[str, Any], found: Recalibration, json: str | None) -> None:
    console = people(json)
    low, high = payload["gain_ci95"]
    gain = f", gain {payload['gain']:.0%}, {low:.0%} to {high:.0%}"
    for label, name, more in (("held out", "holdout", ""), ("held out, clear of contacts", "clear_holdout", gain)):
        before, after = (payload[f"{name}_{when}"]["mse_rad2"] for when in ("before", "after"))
        console.print(f"{label}: {before:.4g} -> [bold]{after:.4g} rad²[/]{more}")
    if found.appeared:
        console.print(plain_text(f"an effect has appeared: {', '.join(found.appeared)}"))
    for line in payload["changed"]:
        console.print(plain_text(f"changed: {line}"))
    for reason in payload["against"]:
        console.print(plain_text(f"against it: {reason}"))
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
    if payload["promoted"]:
        short = payload["version"][:12]
        console.print(f"better; promoted {short} (twin versions diff previous {short})")
    else:
        say_stored(console, payload)
