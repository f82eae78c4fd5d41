"""`twin ladder`: watch the error fall, one named effect after another."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.calibrate import say_stored
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.diagnosis.verdict import IN_WORDS
from twin_daemon.tables import slim_table
from twin_daemon.workflows.ladder import laddered
from twin_daemon.workflows.session import open_session

if TYPE_CHECKING:
    from twin_daemon.diagnosis.stepwise import Ladder


def command(
    recording: options.Recordings,
    holdout: options.Holdouts = None,
    max_steps: Annotated[int, typer.Option("--max-steps", metavar="N", min=0, help="At most so many effects.")] = 6,
    within: Annotated[
        float,
        typer.Option("--within", metavar="S", min=1.0, help="Look for effects no longer than this; fit what is found."),
    ] = 400.0,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.html", help="Draw the error by step.")] = None,
    seed: options.Seed = 0,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    cluster: options.Cluster = None,
    json: options.Json = None,
) -> None:
    """Diagnose, add the strongest effect, refit, and again, until nothing helps on validation data.

    The twin with all effects is stored as a candidate version. Ctrl-C keeps the steps done.
    """
    require_folder(json, plot)
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    whole = session.recordings(recording, trajectory)
    payload, ladder = laddered(session, whole, holdout, trajectory, max_steps, seed, cluster, within)
    if plot is not None:
        from twin_daemon.figures.ladder import ladder_figure
        from twin_daemon.figures.style import write_page

        title = f"{session.hand.name}: the error by what was added"
        write_page(ladder_figure(title, payload["steps"], payload["references"], payload["noise_floor_rad2"]), plot)
    _show(payload, ladder, json)
    emit_json(json, payload)


def _show(payload: dict[str, Any], ladder: Ladder, json: str | None) -> None:
    console = people(json)
    table = slim_table("the error by what was added", ("step", "fitted rad²", "held out rad²", "then it is"))
    for number, step in enumerate(ladder.steps):
        alone = "all values together" if step.together else "start"
        if step.together and step.holdout_mse_rad2 is None:
            alone = "the same, on all of the recording"
        label = alone if step.effect is None else step.name
        said = "-" if step.verdict is None else step.verdict.replace("_", " ")
        table.add_row(plain_text(f"{number} {label}"), _number(step.mse_rad2), _number(step.holdout_mse_rad2), said)
    console.print(table)
    lines = {
        "raw command": "raw_command", "last promoted version": "last_promoted", "parameters alone": "parameters_alone",
    }  # fmt: skip
    for label, name in lines.items():
        line = payload["references"][name]
        if line["mse_rad2"] is not None:
            console.print(
                f"  {label}: {_number(line['mse_rad2'])} fitted, {_number(line['holdout_mse_rad2'])} held out"
            )
    console.print(f"  noise floor of the sensors: {_number(payload['noise_floor_rad2'])} rad²")
    last = ladder.steps[-1]
    if last.verdict is not None:
        console.print(f"[bold]{IN_WORDS[last.verdict]}[/] {plain_text(payload['reason'])}")
    raw = payload["references"]["raw_command"]["holdout_mse_rad2"]
    held_out = ladder.last_judged.holdout_mse_rad2
    if raw is not None and held_out is not None and held_out >= raw:
        console.print("[bold]The raw command still predicts validation data better[/]: do not promote it")
    for name in payload["refused"]:
        console.print(f"{plain_text(name)} was found, but the error on validation data does not fall: not added")
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
    if payload["interrupted"]:
        console.print("interrupted: these are the steps done")
    if len(ladder.steps) > 1:
        say_stored(console, payload)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
