"""`twin calibrate`: fit the model's parameters to recordings and store the result as a version."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.cli.drive import drive
from twin_daemon.errors import UsageError
from twin_daemon.tables import by_kind, place_of, slim_table
from twin_daemon.workflows.calibration import calibrated
from twin_daemon.workflows.session import open_session

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.calibration.calibrate import Calibration
    from twin_daemon.estimation.uncertainty import Estimate

SearchName = Annotated[
    str, typer.Option("--search", metavar="bayes|least-squares|random|pso", help="How the parameters are searched.")
]

Run = Annotated[
    str | None,
    typer.Option("--run", metavar="NAME", help="Drive the hand along this trajectory through the gate, and fit that."),
]


def command(
    recording: options.OptionalRecordings = None,
    run: Run = None,
    holdout: options.Holdouts = None,
    search: SearchName = "least-squares",
    space: options.Space = "physical",
    budget: options.Budget = None,
    seed: options.Seed = 0,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    name: options.As = "operator",
    namespace: options.Namespace = None,
    endpoint: options.Endpoint = None,
    cluster: options.Cluster = None,
    json: options.Json = None,
) -> None:
    """Fit parameters, test them on validation data, and store the result as a candidate version.

    With --run the hand itself is driven along a trajectory, through the gate, and what it does is recorded first.
    Ctrl-C keeps the best so far. Without --holdout every third stretch of time of the recordings is held out.
    """
    from twin_daemon.calibration.spaces import load_space

    require_folder(json)
    if not recording and run is None:
        raise UsageError("nothing to fit", todo="Give --recording R..., or --run NAME to drive the hand")
    load_space(space or "physical")  # before the hand is driven for it
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    driven = [] if run is None else [drive(run, hand, model, namespace, endpoint, name)]
    train = session.recordings([*(recording or []), *driven], trajectory)
    held = session.recordings(holdout or [], trajectory)
    payload, result = calibrated(session, train, held, search, space or "physical", budget, seed, cluster)
    _show(payload, result, json)
    emit_json(json, payload)


def _said(parameter: Estimate) -> str:
    words = (parameter.identifiable or "").replace("_", " ")
    if parameter.at_bound:
        words += ", on its bound"
    if parameter.confused_with:
        words += f", trades off with {plain_text(parameter.confused_with)}"
    return words


def _show(payload: dict[str, Any], result: Calibration, json: str | None) -> None:
    console = people(json)
    table = slim_table(
        f"parameters of '{payload['space']}'",
        ("parameter", "value", "95 % interval", "the data say"),
        words=("the data say",),
    )
    for kind, names in by_kind(list(result.parameters)).items():
        table.add_row(f"[bold]{plain_text(kind)}[/], {result.parameters[names[0]].unit}", "", "", "")
        for name in names:
            p = result.parameters[name]
            span = f"{p.ci95[0]:.3g} .. {p.ci95[1]:.3g}"
            table.add_row(place_of(name), f"{p.value:.4g}", span, _said(p))
    console.print(table)
    console.print(f"fitted:   {result.before_rad2:.4g} -> [bold]{result.after_rad2:.4g} rad²[/]")
    if result.holdout_after_rad2 is not None:
        console.print(f"held out: {result.holdout_before_rad2:.4g} -> [bold]{result.holdout_after_rad2:.4g} rad²[/]")
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
    if result.interrupted:
        console.print("interrupted: this is the best so far")
    console.print(f"{result.evaluations} roll-outs in {result.wall_s:.1f} s")
    say_stored(console, payload)


def say_stored(console: Console, payload: Mapping[str, Any]) -> None:
    """Under which id a result was stored, and whether it is the candidate."""
    short = payload["version"][:12]
    if payload["candidate"]:
        console.print(f"stored as candidate {short} (twin versions show {short}, twin versions promote)")
    else:
        console.print(f"[bold]not better on validation data[/]: stored as {short}, not as the candidate")
