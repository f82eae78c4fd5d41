"""What the data can and cannot tell, before anyone fits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from twin_daemon.workflows.session import Session

if TYPE_CHECKING:
    from twin_daemon.simulation.alignment import Aligned


def checked(session: Session, aligned: Sequence[Aligned], space: str) -> dict[str, Any]:
    """What the command writes."""
    from twin_daemon.calibration.check import advice, prospects
    from twin_daemon.calibration.missing_motion import missing_motion
    from twin_daemon.calibration.motion_choice import information_of, most_informative
    from twin_daemon.calibration.spaces import load_space
    from twin_daemon.comparison.region import region_report

    chosen = load_space(space)
    found = prospects(session.twin, aligned, chosen)
    names = [r.recording.name for r in aligned]
    order = most_informative(names, information_of(session.twin, aligned, chosen))
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
        "motions": {
            "order": [asdict(one) for one in order],
            "missing": [asdict(one) for one in missing_motion(session.twin, aligned)],
        },
        "region": region_report(session.twin, session.region, aligned),
    }


def quality(session: Session, aligned: Aligned) -> dict[str, Any]:
    """One recording's data, in numbers and in words."""
    from twin_daemon.calibration.check import saturated_joints
    from twin_daemon.simulation.alignment import unanswering_joints

    recording = aligned.recording
    saturated, unanswering = saturated_joints(session.twin, aligned), unanswering_joints(session.twin, [aligned])
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
        "unanswering_joints": list(unanswering),
        "warnings": _warnings(aligned, saturated, unanswering),
    }


def _warnings(aligned: Aligned, saturated: Sequence[str], unanswering: Sequence[str]) -> list[str]:
    from twin_daemon.simulation.alignment import not_answering

    recording = aligned.recording
    out = []
    if not aligned.moving.any():
        out.append("no joint moves by more than 0.05 rad: nothing can be fitted; record a motion")
    if recording.commands is None:
        out.append("no commands recorded: the onset is estimated, and a delay cannot be told from it")
    if saturated:
        out.append(f"commands beyond the actuators' range: {', '.join(saturated)}")
    if unanswering:
        out.append(not_answering(unanswering))
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
