"""`twin check`: what the data can and cannot tell, before anyone fits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from twin_daemon.cli import options
from twin_daemon.cli.compare import say_outside
from twin_daemon.cli.console import counted, emit_json, people, plain_text, require_folder
from twin_daemon.tables import by_kind, place_of, slim_table
from twin_daemon.workflows.data_check import checked
from twin_daemon.workflows.session import open_session

if TYPE_CHECKING:
    from rich.console import Console


def command(
    recording: options.Recordings,
    space: options.Space = "physical",
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    json: options.Json = None,
) -> None:
    """Assess recordings before a fit: their quality, and how well they determine each parameter."""
    require_folder(json)
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    report = checked(session, session.recordings(recording, trajectory), space or "physical")
    _show(report, json)
    emit_json(json, report)


def _show(report: dict[str, Any], json: str | None) -> None:
    console = people(json)
    for one in report["recordings"]:
        rate = "unknown" if one["rate_hz"] is None else f"{one['rate_hz']:.1f} Hz"
        console.print(
            f"[bold]{plain_text(one['name'])}[/]: {one['duration_s']:.1f} s, {one['samples']} samples at {rate}, "
            f"{len(one['moving_joints'])} of {counted(one['joints'], 'joint')} move, "
            f"commands {'recorded' if one['commands'] else 'not recorded'}"
        )
        for warning in one["warnings"]:
            console.print(f"  [bold]note[/]: {plain_text(warning)}")
    table = slim_table(
        f"what a fit of '{report['space']}' would learn",
        ("parameter", "the data say", "not told apart from"),
        words=("the data say", "not told apart from"),
    )
    parameters = report["parameters"]
    for kind, names in by_kind(list(parameters)).items():
        table.add_row(f"[bold]{plain_text(kind)}[/]", "", "")
        for name in names:
            p = parameters[name]
            table.add_row(place_of(name), p["verdict"].replace("_", " "), plain_text(p["confused_with"] or ""))
    console.print(table)
    for kind, names in by_kind([n for n, p in parameters.items() if p["advice"]]).items():
        console.print(f"to learn [bold]{plain_text(kind)}[/]: {parameters[names[0]]['advice']}")
    _show_motions(console, report["motions"])
    say_outside(console, report["region"])
    counts = {v: sum(p["verdict"] == v for p in report["parameters"].values()) for v in _ORDER}
    console.print(", ".join(f"{count} {verdict.replace('_', ' ')}" for verdict, count in counts.items()))


def _show_motions(console: Console, motions: dict[str, Any]) -> None:
    """Which motions say most, in the order in which each adds most to those before it, and what all of them lack."""
    from twin_daemon.calibration.missing_motion import WORDS

    if len(motions["order"]) > 1:
        table = slim_table(
            "the motions that say most", ("motion", "adds nats", "all so far", "tells"), words=("motion", "tells")
        )
        for one in motions["order"]:
            learns = plain_text(", ".join(one["learns"]))
            table.add_row(plain_text(one["name"]), f"{one['gain_nats']:.1f}", f"{one['share']:.0%}", learns)
        console.print(table)
    for one in motions["missing"]:
        console.print(f"[bold]{plain_text(one['joint'])}[/] lacks {', '.join(one['lacks'])}")
    for kind in dict.fromkeys(kind for one in motions["missing"] for kind in one["lacks"]):
        console.print(f"  {WORDS[kind]}")


_ORDER = ("identifiable", "weak", "not_identifiable")
