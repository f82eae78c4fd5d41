"""`twin propose`: the law that is missing where no effect of the library fits."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.tables import slim_table
from twin_daemon.workflows.diagnosis import diagnosed, joint_names, train_and_held
from twin_daemon.workflows.progress import streaming

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.proposals.proposal import Proposals

_MOST_TRIED = 8


def command(
    recording: options.Recordings,
    holdout: options.Holdouts = None,
    joints: options.Joints = None,
    diagnosis: Annotated[
        Path | None,
        typer.Option("--diagnosis", metavar="FILE.json", help="What twin diagnose --json wrote for these recordings."),
    ] = None,
    seed: options.Seed = 0,
    within: Annotated[
        float | None,
        typer.Option("--within", metavar="S", min=1.0, help="The diagnosis before it ends after so many seconds."),
    ] = None,
    since: Annotated[
        str | None,
        typer.Option("--since", metavar="VERSION|DATE", help="The law that is missing since a version or a day."),
    ] = None,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    json: options.Json = None,
) -> None:
    """Propose the law that is missing where no effect of the library fits: what it depends on, its shape, a formula.

    The recordings are diagnosed first; only where that ends 'unexplained' a law is searched, at the joint whose error
    is worst over its floor or at --joints. A torque, a change of the command and a change of the reading compete.
    Several effects of the library at one place are asked for where the laws do not account for all of the error.
    What holds on held-out motion is written as an effect file that twin add takes: a proposal, not a cause.
    With --since the law is searched beside that version's twin, where no change of it accounts for the error.
    """
    from twin_daemon.proposals.propose import propose
    from twin_daemon.workflows import changes

    require_folder(json)
    changes.require_one(since, None, version, terms, None)
    session, stored = changes.open_since(since, hand, model, version=version, terms=terms, joint_map=joint_map)
    recorded = session.recordings(recording, trajectory)
    chosen = joint_names(session.twin, joints)
    began = time.perf_counter()
    train, held, notes = train_and_held(session, recorded, holdout, trajectory)
    ask = partial(diagnosed, session.twin, train, held, joints=chosen, seed=seed)
    further = None
    if diagnosis is not None:
        from twin_daemon.diagnosis.verdict import Diagnosis
        from twin_daemon.report.finished import read_result

        found = read_result(diagnosis, Diagnosis, "twin diagnose")
    elif stored is not None:
        earlier = changes.earlier_of(session, None, stored, trajectory)
        found = changes.diagnosed_since(session, recorded, held, earlier, joints, seed, within)[1]
    else:
        asked = time.perf_counter()
        found = ask(most_effects=1, within_s=within)
        left_s = None if within is None else max(within - (time.perf_counter() - asked), 1.0)
        further = partial(ask, within_s=left_s)
    with streaming() as say:
        result = propose(session.twin, train, held, found, joints=chosen, seed=seed, stream=say, further=further)
    payload = {
        **result.model_dump(),
        "hand": session.hand.name,
        "version": session.version,
        "since_version": None if stored is None else stored.id,
        "notes": [*notes, *result.notes],
        "wall_s": time.perf_counter() - began,
    }
    _show(people(json), result, payload)
    emit_json(json, payload)


def _show(console: Console, result: Proposals, payload: dict[str, Any]) -> None:
    if not result.proposals:
        console.print("[bold]No proposal[/]")
        console.print(f"  {plain_text(result.reason)}")
    for one in result.proposals:
        low, high = one.holdout_gain_ci95
        console.print(f"[bold]{one.name}[/] at [bold]{plain_text(', '.join(one.joints))}[/]: a proposal, not a cause")
        console.print(f"  {one.port} over {plain_text(' x '.join(one.variables))}: {plain_text(one.formula)}")
        for name, value in one.parameters.items():
            console.print(f"  {name} = {value.value:.4g} (95 %: {value.ci95[0]:.4g} to {value.ci95[1]:.4g})")
        console.print(
            f"  held out: {one.holdout_mse_before:.3g} -> {one.holdout_mse_after:.3g} rad², gain "
            f"{one.holdout_gain:.0%} (95 %: {low:.0%} to {high:.0%}); probability {one.probability:.0%}"
        )
        visited = one.curve.visited
        if visited[1] > visited[0]:
            console.print(
                f"  known from {visited[0]:.3g} to {visited[1]:.3g} {one.curve.at_unit}, flat or unknown beyond"
            )
        for near in one.nearest:
            console.print(f"  nearest: {plain_text(near.effect)}: {plain_text(near.fails_because)}")
        console.print(f"  as a model: {one.native.cost or 'all of it is in the twin'}")
        console.print(f"  test it: {one.experiment}")
        console.print(f"  {one.file}", markup=False)
        console.print(f"Add it: twin add {one.name} --joint {one.joints[0]}", markup=False)
    if result.tried:
        table = slim_table(
            f"what else was tried ({min(_MOST_TRIED, len(result.tried))} of {len(result.tried)})",
            ("law", "one step", "held out", "why not"),
            words=("why not",),
        )
        for row in result.tried[:_MOST_TRIED]:
            held = "" if row.holdout_gain is None else f"{row.holdout_gain:.0%}"
            law = plain_text(f"{row.port}: {' x '.join(row.variables)}")
            table.add_row(law, f"{row.linear_gain:.0%}", held, row.lost_because)
        console.print(table)
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
