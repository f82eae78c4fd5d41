"""`twin ladder`: watch the error fall, one named effect after another."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.add import draft_of
from twin_daemon.cli.calibrate import fitted_values, say_stored
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.diagnose import streaming, train_and_held
from twin_daemon.cli.session import Session, open_session, require_folder
from twin_daemon.cli.tables import slim_table
from twin_daemon.diagnosis.verdict import IN_WORDS

if TYPE_CHECKING:
    from twin_daemon.diagnosis.stepwise import Ladder
    from twin_daemon.simulation.alignment import Aligned


def command(
    recording: options.Recordings,
    holdout: options.Holdouts = None,
    max_steps: Annotated[int, typer.Option("--max-steps", metavar="N", min=0, help="At most so many effects.")] = 6,
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
    payload, ladder = laddered(session, whole, holdout, trajectory, max_steps, seed, cluster)
    if plot is not None:
        from twin_daemon.figures.ladder import ladder_figure
        from twin_daemon.figures.style import write_page

        title = f"{session.hand.name}: the error by what was added"
        write_page(ladder_figure(title, payload["steps"], payload["references"], payload["noise_floor_rad2"]), plot)
    _show(payload, ladder, json)
    emit_json(json, payload)


def laddered(
    session: Session,
    whole: list[Aligned],
    holdout: Sequence[Path] | None,
    trajectory: str | None,
    max_steps: int,
    seed: int,
    cluster: str | None = None,
) -> tuple[dict[str, Any], Ladder]:
    """(what the command writes, the same as values); the version is stored."""
    from twin_daemon.diagnosis.stepwise import stepwise
    from twin_daemon.executor import on_cluster

    train, held, notes = train_and_held(session, whole, holdout, trajectory)
    began = time.perf_counter()
    with on_cluster(cluster), streaming() as say:
        ladder = stepwise(
            session.twin, train, held, max_steps=max_steps, whole=() if holdout else whole, seed=seed, say=say
        )
    payload = {**_payload(session, ladder, train, held), "notes": notes, "seed": seed}
    payload["version"], payload["candidate"] = _store(session, ladder, payload, train, held, seed)
    payload["wall_s"] = time.perf_counter() - began
    return payload, ladder


def _payload(session: Session, ladder: Ladder, train: list[Aligned], held: list[Aligned]) -> dict[str, Any]:
    from twin_daemon.comparison.report import comparison_report

    promoted = session.last_promoted()
    (fitted, _), (held_out, _) = (comparison_report(session.twin, r, promoted) for r in (train, held))
    references = {
        name: {
            "mse_rad2": fitted["references"][name]["mse_rad2"],
            "holdout_mse_rad2": held_out["references"][name]["mse_rad2"],
        }
        for name in ("raw_command", "last_promoted")
    }
    alone, alone_held = ladder.parameters_alone
    references["parameters_alone"] = {"mse_rad2": alone, "holdout_mse_rad2": alone_held}
    return {
        "hand": session.hand.name,
        "verdict": ladder.steps[-1].verdict,
        "reason": ladder.reason,
        "steps": [step.model_dump() for step in ladder.steps],
        "refused": ladder.refused,
        "references": references,
        "noise_floor_rad2": fitted["noise_floor_rad2"],
        "interrupted": ladder.interrupted,
        "parent": session.version,
        "terms": ladder.twin.terms.as_json(),
        "parameters": fitted_values(ladder.parameters),
    }


def _store(
    session: Session, ladder: Ladder, payload: dict[str, Any], train: list[Aligned], held: list[Aligned], seed: int
) -> tuple[str | None, bool]:
    """(the version with all effects, whether it is the candidate); where none was added the one at the start."""
    added = [step for step in ladder.steps if step.effect is not None]
    if not added:
        return session.version, False
    first, last, judged = ladder.steps[0], ladder.steps[-1], ladder.last_judged
    errors = {
        "before": {"mse_rad2": first.mse_rad2},
        "after": {"mse_rad2": last.mse_rad2},
        "holdout_before": {"mse_rad2": first.holdout_mse_rad2},
        "holdout_after": {"mse_rad2": judged.holdout_mse_rad2},
    }
    fitted = {"parameters": payload["parameters"]}
    title = "ladder: " + ", ".join(f"{step.effect} at {step.target}" for step in added)
    draft = draft_of(session, ladder.twin, "effect_added", title, {**errors, "seed": seed, **fitted}, train, held)
    stored = session.store.propose(draft, ladder.twin.mjcf())
    return stored.version.id, stored.candidate


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
