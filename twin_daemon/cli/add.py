"""`twin add`: put an effect into the twin, fit it where there are recordings, and store a candidate version."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin_daemon.cli import options
from twin_daemon.cli.calibrate import say_stored
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.cli.diagnose import show_free_errors
from twin_daemon.errors import UsageError
from twin_daemon.tables import slim_table
from twin_daemon.workflows.change import (
    added_to,
)
from twin_daemon.workflows.session import open_session
from twin_daemon.workflows.take_over import read_finding


def command(
    effect: options.OptionalEffectKey = None,
    joint: options.OptionalJointNames = None,
    finding: options.FindingRef = None,
    set: options.Settings = None,
    recording: options.OptionalRecordings = None,
    holdout: options.Holdouts = None,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    terms: options.Terms = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    json: options.Json = None,
) -> None:
    """Add an effect at each joint ('hand' for effects of the whole hand, 'robot' for all joints alike) and store it.

    It becomes a candidate version.
    With recordings the effect's values are fitted, the model's uncertain parameters beside them under priors; what
    --set gives stays as given. Without recordings the values are those of --set, and typical ones for the rest.
    With --finding nothing is fitted: EFFECT, joint, values, intervals and recordings are those of the diagnosis.
    """
    require_folder(json)
    taken = read_finding(finding) if finding is not None else None
    if taken is not None:
        if set:
            raise UsageError("--finding and --set exclude each other", todo="A finding has its values")
        version = version if version is not None or terms is not None else taken.version
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    if taken is not None:
        effect, joint, recording, holdout = taken.wanted(effect, joint, recording, holdout, session)
    if effect is None or not joint:
        raise UsageError(
            "nothing to add", todo="Give EFFECT and --joint J..., or --finding FILE of twin diagnose --json FILE"
        )
    payload = added_to(
        session, effect, joint, options.settings(set), recording, holdout, trajectory=trajectory, taken=taken
    )
    show_change(f"{effect} added at {', '.join(payload['targets'])}", payload, json)
    emit_json(json, payload)


# -- what add and remove share -----------------------------------------------------------------------------


def show_change(title: str, payload: Mapping[str, Any], json: str | None) -> None:
    """What was changed and what it did to the errors, for people."""
    console = people(json)
    console.print(f"[bold]{plain_text(title)}[/]")
    if payload.get("parameters"):
        table = slim_table("fitted", ("parameter", "value", "95 % interval", "unit"))
        for name, p in payload["parameters"].items():
            mark = " on its bound" if p["at_bound"] else ""
            table.add_row(
                plain_text(name), f"{p['value']:.4g}{mark}", f"{p['ci95'][0]:.3g} .. {p['ci95'][1]:.3g}", p["unit"]
            )
        console.print(table)
    before, after = (payload[when]["mse_rad2"] for when in ("before", "after"))
    if before is not None and after is not None:
        console.print(f"  recorded, one free roll-out of the whole hand: {before:.4g} -> [bold]{after:.4g} rad²[/]")
    if (found := payload.get("finding")) is not None:
        pieces = (found[f"holdout_mse_{when}"] for when in ("before", "after"))
        console.print("  held out, in short pieces of its part: {:.4g} -> {:.4g} rad²".format(*pieces))
    held = ("holdout_before", "holdout_after", "holdout_joints_before", "holdout_joints_after")
    show_free_errors(console, *(payload[name]["mse_rad2"] for name in held))
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
    say_stored(console, payload)
