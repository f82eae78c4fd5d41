"""`twin remove`: take an effect out of the twin again and store a candidate version."""

from __future__ import annotations

from twin_daemon.cli import options
from twin_daemon.cli.add import show_change
from twin_daemon.cli.console import emit_json, require_folder
from twin_daemon.errors import BadInput
from twin_daemon.places import ROBOT
from twin_daemon.workflows.change import data_of, draft_of, errors, known_effect
from twin_daemon.workflows.session import open_session


def command(
    effect: options.EffectKey,
    joint: options.JointNames,
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
    """Remove an effect from the twin at each joint ('robot': at all servos or joints), and store a candidate version.

    The other terms stay. With recordings it says what the twin loses by it.
    """
    require_folder(json)
    session = open_session(hand, model, version=version, terms=terms, joint_map=joint_map)
    kind = known_effect(effect)
    places = list(dict.fromkeys(session.twin.place(name).target for name in joint))
    present = [t.target for t in session.twin.terms.effects if t.effect == kind.key]
    all_of_them = session.twin.joints if kind.shared == "joints" else session.twin.actuators
    everywhere = [name for name in all_of_them if name in present]
    targets = everywhere or places if ROBOT in places else places
    for target in targets:
        if target not in present:
            raise BadInput(
                f"the twin has no '{effect}' at '{target}'",
                where=session.version[:12] if session.version else "the nominal model",
                allowed=f"{effect} at {', '.join(present)}" if present else None,
                todo=None if present else "Name the version that has it with --version",
            )
    changed = session.twin.changed(session.twin.terms.without_effect(kind.key, set(targets)))
    train, held, notes = data_of(session, recording, holdout, trajectory)
    title = f"{effect} removed at {', '.join(places)}"
    payload = {
        "effect": effect,
        "targets": targets,
        **errors(session.twin, changed, train, held, session.twin.joints_of_all(targets)),
        "terms": changed.terms.as_json(),
        "parent": session.version,
        "notes": notes,
    }
    draft = draft_of(session, changed, "effect_removed", title, payload, train, held)
    stored = session.store.propose(draft, changed.mjcf())
    payload["version"], payload["candidate"] = stored.version.id, stored.candidate
    show_change(title, payload, json)
    emit_json(json, payload)
