"""`twin diagnose`: which physical effect the twin lacks, or the plain word that the data do not say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import ValidationError

from twin_daemon.cli import options
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.diagnosis.verdict import in_hundred
from twin_daemon.errors import BadInput, UsageError
from twin_daemon.estimation.estimate import with_unit
from twin_daemon.hand.schema import NominalUncertainty
from twin_daemon.tables import slim_table
from twin_daemon.workflows.diagnosis import judged
from twin_daemon.workflows.session import open_session

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.diagnosis.verdict import Diagnosis, Finding, MotionError


_MOST_TRIED = 10
_MOST_WHERE = 8


def command(
    recording: options.Recordings,
    holdout: options.Holdouts = None,
    joints: options.Joints = None,
    seed: options.Seed = 0,
    within: Annotated[
        float | None,
        typer.Option("--within", metavar="S", min=1.0, help="End after so many seconds, with what is known by then."),
    ] = None,
    tolerance_mrad: Annotated[
        float | None,
        typer.Option("--tolerance-mrad", metavar="MRAD", min=1e-3, max=1e3, help="Errors up to this do not matter."),
    ] = None,
    nominal_uncertainty: Annotated[
        list[str] | None,
        typer.Option(
            "--nominal-uncertainty",
            metavar="[KIND=]SHARE",
            help="How far the model's numbers may be off: 0 for an exact model, gain=0.2 for one kind.",
        ),
    ] = None,
    since: Annotated[
        str | None,
        typer.Option("--since", metavar="VERSION|DATE", help="What has changed since a version, or since a day."),
    ] = None,
    baseline: Annotated[
        list[Path] | None,
        typer.Option("--baseline", metavar="R...", help="What has changed since these recordings of the healthy hand."),
    ] = None,
    covariate: Annotated[
        Path | None,
        typer.Option(
            "--covariate",
            metavar="FILE.csv",
            help="With --since or --baseline: the temperature by time, which is no wear.",
        ),
    ] = None,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    cluster: options.Cluster = None,
    json: options.Json = None,
) -> None:
    """Name the physical effects that the twin lacks, with evidence, or say that the data cannot tell.

    Every effect of the library is refitted where it could act, and counts only if motion that it was not fitted to
    gets better by it. Candidates appear as they are tested; Ctrl-C keeps what is done. Nothing is stored but, where
    the data cannot decide, a trajectory that would.
    """
    from twin_daemon.executor import on_cluster

    require_folder(json)
    assumed = assumptions(tolerance_mrad, nominal_uncertainty)
    if covariate is not None and since is None and not baseline:
        raise UsageError("--covariate compares two sessions", todo="Give the earlier one with --baseline or --since")
    if since is not None or baseline:
        from twin_daemon.cli.since import show
        from twin_daemon.workflows import changes

        changes.require_one(since, baseline, version, terms, cluster)
        given = {"version": version, "terms": terms, "joint_map": joint_map, "assumed": assumed}
        session, stored = changes.open_since(since, hand, model, **given)
        recorded = session.recordings(recording, trajectory)
        earlier = changes.earlier_of(session, baseline, stored, trajectory)
        held = session.recordings(holdout or [], trajectory)
        payload, what = changes.diagnosed_since(session, recorded, held, earlier, joints, seed, within, covariate)
        show(people(json), what)
        emit_json(json, payload)
        return
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map, assumed=assumed)
    recorded = session.recordings(recording, trajectory)
    with on_cluster(cluster):
        payload, found = judged(session, recorded, holdout, trajectory, joints, seed, within)
    _show(people(json), payload, found)
    emit_json(json, payload)


def assumptions(tolerance_mrad: float | None, uncertainty: Sequence[str] | None) -> dict[str, Any]:
    """Fields of a hand's description that a command line overrides. BadInput for a kind or a share that is none."""
    found: dict[str, Any] = {} if tolerance_mrad is None else {"tolerance_rad": 1e-3 * tolerance_mrad}
    if not uncertainty:
        return found
    shares: dict[str, float] = {}
    each = [name for name in NominalUncertainty.model_fields if name != "parameters"]
    every = [name for name in each if name != "between_sessions"]  # no number of a model is off by that
    for text in uncertainty:
        kind, _, share = text.rpartition("=")
        kinds = [kind] if kind else every
        try:
            shares |= NominalUncertainty.model_validate(dict.fromkeys(kinds, share)).model_dump(include=set(kinds))
        except ValidationError:
            raise BadInput(
                f"--nominal-uncertainty {text}: no share of a nominal value",
                allowed=f"0 to 1, or one of {', '.join(each)} = 0 to 1",
            ) from None
    return found | {"nominal_uncertainty": shares}


# -- for people --------------------------------------------------------------------------------------------


def _show(console: Console, payload: dict[str, Any], found: Diagnosis) -> None:
    console.print(f"[bold]{found.in_words}[/]")
    console.print(f"  {plain_text(found.reason)}")
    if found.probabilities:
        console.print(f"  {plain_text('; '.join(map(str, found.probabilities)))}")
    for finding in found.findings:
        show_finding(console, finding)
    for moved in found.moved_parameters:
        console.print(plain_text(str(moved)))
    _show_where(console, found)
    _show_tried(console, found)
    for note in found.notes:
        console.print(f"note: {plain_text(note)}")
    for line in _how_to_go_on(found):
        console.print(line, markup=False)


def show_finding(console: Console, finding: Finding) -> None:
    """One finding: its values with their intervals, what it does on held-out motion, and what it means."""
    low, high = finding.holdout_gain_ci95
    console.print(f"\n[bold]{plain_text(finding.effect)}[/] at [bold]{plain_text(finding.target)}[/]")
    for name, p in finding.parameters.items():
        value = with_unit(f"{p.value:.4g}", p.unit)
        console.print(f"  {name} = {value} (95 %: {p.ci95[0]:.4g} to {p.ci95[1]:.4g})")
    console.print(
        f"  held out, in short pieces of its part: {finding.holdout_mse_before_rad2:.3g} -> "
        f"{finding.holdout_mse_after_rad2:.3g} rad², gain {finding.holdout_gain:.0%} "
        f"(95 %: {low:.0%} to {high:.0%})"
    )
    show_worst_motion(console, finding.holdout_motions)
    probable = "" if finding.probability is None else f", probability {in_hundred(finding.probability)}"
    console.print(f"  evidence {finding.evidence_nats:.0f} nats{probable}")
    show_free_errors(
        console,
        finding.free_holdout_mse_before_rad2,
        finding.free_holdout_mse_after_rad2,
        finding.free_holdout_joints_mse_before_rad2,
        finding.free_holdout_joints_mse_after_rad2,
    )
    if finding.confusable_with:
        console.print(f"  not told apart from: {plain_text(', '.join(finding.confusable_with))}")
    console.print(f"  {plain_text(finding.explanation)}")


def show_worst_motion(console: Console, motions: Sequence[MotionError]) -> None:
    """Of several held-out recordings the one that is predicted worst: it decides."""
    if len(motions) < 2:
        return
    worst = max(motions, key=lambda motion: motion.left)
    console.print(
        f"  of {len(motions)} motions the worst is {plain_text(worst.name)}: {worst.mse_before_rad2:.3g} -> "
        f"{worst.mse_after_rad2:.3g} rad², {worst.left:.1f} times what a right model may leave"
    )


def show_free_errors(
    console: Console, before: float | None, after: float | None, own_before: float | None, own_after: float | None
) -> None:
    """The held-out errors (rad^2) of a free roll-out, of the whole hand and of an effect's joints."""
    if before is None or after is None:
        return
    console.print(f"  held out, one free roll-out of the whole hand: {before:.4g} -> [bold]{after:.4g} rad²[/]")
    if own_before is not None and own_after is not None:
        console.print(f"  the same over its joints: {own_before:.4g} -> {own_after:.4g} rad²")


def _show_where(console: Console, found: Diagnosis) -> None:
    if not found.where:
        return
    table = slim_table("where it fails", ("joint", "while", "rmse mrad", "over its mean"), words=("while",))
    for row in found.where[:_MOST_WHERE]:
        table.add_row(plain_text(row.joint), row.condition, f"{1e3 * row.rmse_rad:.2f}", f"{row.times_average:.1f}x")
    console.print(table)


def _show_tried(console: Console, found: Diagnosis) -> None:
    if not found.tried:
        return
    best = sorted(found.tried, key=lambda trial: -trial.evidence_nats)[:_MOST_TRIED]
    table = slim_table(
        f"what else was tried ({len(best)} of {len(found.tried)})",
        ("candidate", "evidence, nats", "why not"),
        words=("why not",),
    )
    for trial in best:
        table.add_row(plain_text(f"{trial.effect}:{trial.target}"), f"{trial.evidence_nats:.0f}", trial.lost_because)
    console.print(table)


def _how_to_go_on(found: Diagnosis) -> list[str]:
    lines = []
    if found.next_experiment is not None:
        lines.append(f"Next experiment: run {found.next_experiment.path}, record it, and diagnose it with this one.")
        lines.append(f"  {found.next_experiment.why}")
    if found.findings and found.verdict != "ambiguous":
        first = found.findings[0]
        lines.append(
            f"Add it: twin add {first.effect} --joint {first.target} --recording R... fits it, "
            "twin add --finding FILE.json takes this over from --json FILE.json (twin ladder adds all)"
        )
    if found.verdict == "unexplained" and found.interrupted:
        lines.append("Give it more time (--within), or name the joints that matter (--joints).")
    elif found.verdict == "unexplained":
        lines.append("Look at the joints and conditions above: 'twin effects' does not list the cause.")
        lines.append("To search for the law itself: twin propose, with the same recordings")
    return lines
