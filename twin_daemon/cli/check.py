"""`twin check`: what the data can and cannot tell, before anyone fits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from twin_daemon.cli import options
from twin_daemon.cli.console import counted, emit_json, people, plain_text
from twin_daemon.cli.session import Session, open_session, require_folder
from twin_daemon.cli.tables import by_kind, place_of, slim_table

if TYPE_CHECKING:
    from twin_daemon.simulation.alignment import Aligned


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


def checked(session: Session, aligned: Sequence[Aligned], space: str) -> dict[str, Any]:
    """What the command writes."""
    from twin_daemon.calibration.check import advice, prospects
    from twin_daemon.calibration.spaces import load_space

    chosen = load_space(space)
    found = prospects(session.twin, aligned, chosen)
    return {
        "hand": session.hand.name,
        "space": chosen.name,
        "recordings": [quality(session, r) for r in aligned],
        "parameters": {
            name: {
                "verdict": p.identifiable,
                "identifiable": p.identifiable == "identifiable",
                "unit": p.unit,
                "ci95_width": p.ci95[1] - p.ci95[0],
                "confused_with": p.confused_with,
                "advice": advice(name, p),
            }
            for name, p in found.items()
        },
    }


def quality(session: Session, aligned: Aligned) -> dict[str, Any]:
    """One recording's data, in numbers and in words."""
    from twin_daemon.calibration.check import saturated_joints

    recording = aligned.recording
    saturated = saturated_joints(session.twin, aligned)
    still = [name for name, moves in zip(aligned.joints, aligned.moving, strict=True) if not moves]
    absent = [name for name in session.twin.joints if name not in recording.joints]
    return {
        "name": recording.name,
        "sha256": recording.sha256,
        "duration_s": recording.duration_s,
        **recording.quality.as_dict(),
        "commands": recording.commands is not None,
        "onset_s": aligned.onset_s,
        "joints": len(recording.joints),
        "moving_joints": [n for n in aligned.joints if n not in still],
        "still_joints": still,
        "absent_joints": absent,
        "saturated_commands": saturated,
        "warnings": _warnings(aligned, saturated),
    }


def _warnings(aligned: Aligned, saturated: list[str]) -> list[str]:
    recording = aligned.recording
    out = []
    if not aligned.moving.any():
        out.append("no joint moves by more than 0.05 rad: nothing can be fitted; record a motion")
    if recording.commands is None:
        out.append("no commands recorded: the onset is estimated, and a delay cannot be told from it")
    if saturated:
        out.append(f"commands beyond the actuators' range: {', '.join(saturated)}")
    if recording.duration_s < 3.0:
        out.append(f"only {recording.duration_s:.1f} s long: too short to hold a part of it out")
    dropped = sum(recording.quality.dropped.values())
    if dropped > 0.01 * len(recording.stamp_ns):
        out.append(f"{dropped} messages or values dropped: look at the driver before trusting a fit")
    return out


def warn_before_fit(session: Session, recordings: list[Aligned]) -> list[str]:
    """What `twin check` would say of the data, in a few notes for a command that is about to fit."""
    notes = []
    for aligned in recordings:
        for warning in quality(session, aligned)["warnings"]:
            notes.append(f"{aligned.recording.name}: {warning}")
    return notes


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
    counts = {v: sum(p["verdict"] == v for p in report["parameters"].values()) for v in _ORDER}
    console.print(", ".join(f"{count} {verdict.replace('_', ' ')}" for verdict, count in counts.items()))


_ORDER = ("identifiable", "weak", "not_identifiable")
