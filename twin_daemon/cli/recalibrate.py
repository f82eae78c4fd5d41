"""`twin recalibrate`: follow the wear of the hand, never for the worse."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import options
from twin_daemon.cli.add import draft_of
from twin_daemon.cli.calibrate import Run, fitted_values, progress_bar, say_stored
from twin_daemon.cli.commanding import As
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.drive import drive
from twin_daemon.cli.run import Endpoint, Namespace
from twin_daemon.cli.session import Session, open_session, require_folder
from twin_daemon.errors import UsageError

if TYPE_CHECKING:
    from twin_daemon.recalibration.recalibrate import Recalibration
    from twin_daemon.simulation.alignment import Aligned


def command(
    recording: options.OptionalRecordings = None,
    run: Run = None,
    holdout: options.Holdouts = None,
    joints: options.Joints = None,
    within: Annotated[
        float | None,
        typer.Option(
            "--within",
            metavar="S",
            min=1.0,
            help="Use so many seconds of all cores, a diagnosis included.",
        ),
    ] = None,
    promote: Annotated[bool, typer.Option("--promote", help="Promote the result if it is better.")] = False,
    budget: options.Budget = None,
    seed: options.Seed = 0,
    hand: options.HandName = None,
    model: options.Model = None,
    version: options.VersionRef = None,
    trajectory: options.TrajectoryRef = None,
    joint_map: options.JointMap = None,
    name: As = "operator",
    namespace: Namespace = None,
    endpoint: Endpoint = None,
    json: options.Json = None,
) -> None:
    """Fit the version in use to what the hand does now, and decide whether the result is better.

    A Bayesian search around the version; where parameters alone do not explain the change, a diagnosis names the effect
    that has appeared. The result is stored as the candidate. Ctrl-C keeps the best so far.
    """
    from twin_daemon.comparison.split import hold_out
    from twin_daemon.recalibration.recalibrate import recalibrate

    require_folder(json)
    if not recording and run is None:
        raise UsageError("nothing to fit", todo="Give --recording R..., or --run NAME to drive the hand")
    session = open_session(hand, model, version=version, joint_map=joint_map)
    driven = [] if run is None else [drive(run, hand, model, namespace, endpoint, name)]
    train = session.recordings([*(recording or []), *driven], trajectory)
    held = session.recordings(holdout or [], trajectory)
    notes = []
    if not held:
        train, held = hold_out(train)
        notes.append("no --holdout: every third stretch of each recording is held out, so the intervals are wider")
    began = time.monotonic()
    console = people("-")
    with progress_bar("Bayesian search over 'wear'", budget) as report:
        found = recalibrate(
            session.twin,
            train,
            held,
            promised_rad2=_promised(session),
            joints=joints or (),
            budget=budget,
            seconds=within,
            seed=seed,
            progress=report,
            say=lambda line: console.print(plain_text(line)),
        )
    payload = _payload(session, found, held, notes, seed)
    draft = draft_of(session, found.twin, "recalibrated", _title(found), payload, train, held)
    stored = session.store.propose(draft, found.twin.mjcf())
    payload["version"], payload["candidate"] = stored.version.id, stored.candidate
    worse = session.store.worse_than_current(stored.version)
    if worse is not None:
        payload["against"].append(f"worse than the version in use: {worse.words}")
    payload["better"] = not payload["against"]
    payload["promoted"] = promote and payload["better"]
    if payload["promoted"]:
        session.store.promote(stored.version.id)
    payload["wall_s"] = time.monotonic() - began
    _show(payload, found, json)
    emit_json(json, payload)


def _title(found: Recalibration) -> str:
    return "recalibrated: " + (", ".join(found.appeared) + " has appeared" if found.appeared else "values alone")


def _promised(session: Session) -> float | None:
    """The error (rad^2) that the version in question promises, clear of contacts where it says so."""
    from twin_daemon.versions import promised_rad2

    if session.version is None:
        return None
    version = session.store.get(session.version)
    clear = version.mse_rad2("clear_holdout_after")
    return promised_rad2(version.errors) if clear is None else clear


def _payload(
    session: Session, found: Recalibration, held: list[Aligned], notes: list[str], seed: int
) -> dict[str, Any]:
    from twin_daemon.diagnosis.free_rollout import mean_error

    decision, fitted = found.decision, found.calibration
    return {
        "hand": session.hand.name,
        "parent": session.version,
        "before": {"mse_rad2": fitted.before_rad2},
        "after": {"mse_rad2": fitted.after_rad2 if found.ladder is None else found.ladder.steps[-1].mse_rad2},
        "holdout_before": {"mse_rad2": mean_error(session.twin, held)},
        "holdout_after": {"mse_rad2": mean_error(found.twin, held)},
        "clear_holdout_before": {"mse_rad2": decision.before_rad2},
        "clear_holdout_after": {"mse_rad2": decision.after_rad2},
        "gain": decision.gain,
        "gain_ci95": list(decision.gain_ci95),
        "against": list(decision.against),
        "appeared": list(found.appeared),
        "verdict": None if found.ladder is None else found.ladder.last_judged.verdict,
        "parameters": fitted_values(found.parameters),
        "evaluations": fitted.evaluations,
        "interrupted": fitted.interrupted,
        "notes": notes,
        "seed": seed,
    }


def _show(payload: dict[str, Any], found: Recalibration, json: str | None) -> None:
    console = people(json)
    low, high = payload["gain_ci95"]
    gain = f", gain {payload['gain']:.0%}, {low:.0%} to {high:.0%}"
    for label, name, more in (("held out", "holdout", ""), ("held out, clear of contacts", "clear_holdout", gain)):
        before, after = (payload[f"{name}_{when}"]["mse_rad2"] for when in ("before", "after"))
        console.print(f"{label}: {before:.4g} -> [bold]{after:.4g} rad²[/]{more}")
    if found.appeared:
        console.print(plain_text(f"an effect has appeared: {', '.join(found.appeared)}"))
    for reason in payload["against"]:
        console.print(plain_text(f"against it: {reason}"))
    for note in payload["notes"]:
        console.print(f"note: {plain_text(note)}")
    if payload["promoted"]:
        short = payload["version"][:12]
        console.print(f"better; promoted {short} (twin versions diff previous {short})")
    else:
        say_stored(console, payload)
