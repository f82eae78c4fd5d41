"""A diagnosis of recordings, and what is said of it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_daemon.diagnosis.verdict import RecordingRead
from twin_daemon.workflows.progress import streaming
from twin_daemon.workflows.session import Session, held_out, in_turn, take_turns

if TYPE_CHECKING:
    from twin_daemon.diagnosis.verdict import Diagnosis
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.simulation.twin import TwinModel


LEAST_S = 3.0
"""A recording that is shorter says nothing."""


def judged(
    session: Session,
    recorded: Sequence[Aligned],
    holdout: Sequence[Path] | None,
    trajectory: str | None,
    joints: Sequence[str] | None,
    seed: int,
    within_s: float | None = None,
) -> tuple[dict[str, Any], Diagnosis]:
    """(what the command writes, the same as values), with the next experiment where the data cannot decide."""
    from twin_daemon.diagnosis.free_rollout import with_free_errors

    chosen = joint_names(session.twin, joints)
    began = time.perf_counter()
    train, held = list(recorded), []
    short = [r.recording.name for r in train if r.time_s[-1] < LEAST_S]
    notes: list[str] = []
    if short:
        found = _too_short(short)
    else:
        train, held, notes = in_turn(train, session.recordings(holdout or [], trajectory))
        found = diagnosed(session.twin, train, held, joints=chosen, seed=seed, within_s=within_s)
    notes += ended_early(found, within_s)
    if found.verdict in ("ambiguous", "not_excited"):
        from twin_daemon.diagnosis.experiment_design import next_experiment
        from twin_daemon.resources import state_dir

        proposed = next_experiment(session.twin, train, found, state_dir() / "experiments", chosen)
        found = found.model_copy(update={"next_experiment": proposed})
    # what takes turns has been fitted as well: a free roll-out of it would flatter
    found = with_free_errors(session.twin, () if take_turns(train, held) else held, found)
    about = {
        "hand": session.hand.name,
        "version": session.version,
        "seed": seed,
        "terms": session.twin.terms,
        "fitted_on": read_from(recorded),
        "held_out_on": read_from(held) if holdout else (),
    }
    found = found.model_copy(update={"notes": (*notes, *found.notes), **about})
    return {**found.model_dump(by_alias=True), "wall_s": time.perf_counter() - began}, found


def ended_early(found: Diagnosis, within_s: float | None) -> list[str]:
    """What has to be said of an answer that was interrupted. KeyboardInterrupt where it says nothing, and nobody asked
    for what is known by then."""
    if found.interrupted and not found.parts and within_s is None:
        raise KeyboardInterrupt
    return (
        [f"ended early: the verdict speaks of {', '.join(found.parts) or 'nothing'} only"] if found.interrupted else []
    )


def read_from(recordings: Sequence[Aligned]) -> tuple[RecordingRead, ...]:
    """Where recordings came from, each once."""
    files = [r.recording for r in recordings]
    return tuple(RecordingRead(path=str(r.path.absolute()), name=r.name, sha256=r.sha256) for r in files)


def joint_names(twin: TwinModel, given: Sequence[str] | None) -> list[str] | None:
    """The twin's own names of joints; a command stands for what it drives. BadInput with the nearest name."""
    if not given:
        return None
    names: list[str] = []
    for target in given:
        place = twin.place(target)
        if place.joint is not None:
            names.append(place.target)
        else:
            names += twin.joints_of(place.target)
    return list(dict.fromkeys(names))


def train_and_held(
    session: Session, recorded: Sequence[Aligned], holdout: Sequence[Path] | None, trajectory: str | None
) -> tuple[list[Aligned], list[Aligned], list[str]]:
    """(recordings to fit, recordings to judge by, what has to be said about them)."""
    return held_out(recorded, session.recordings(holdout or [], trajectory))


def _too_short(names: Sequence[str]) -> Diagnosis:
    from twin_daemon.diagnosis.verdict import Diagnosis

    reason = f"{', '.join(names)}: shorter than {LEAST_S:g} s; record 15 s or more with steps, two speeds and holds"
    return Diagnosis.without_findings("not_excited", reason)


def diagnosed(
    twin: TwinModel,
    train: Sequence[Aligned],
    held: Sequence[Aligned],
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    most_effects: int | None = None,
    within_s: float | None = None,
) -> Diagnosis:
    """The diagnosis, each candidate on standard error as soon as it is judged."""
    from twin_daemon.diagnosis.search import diagnose
    from twin_daemon.diagnosis.thresholds import MOST_EFFECTS
    from twin_daemon.processor_time import TimeLimit

    most = MOST_EFFECTS if most_effects is None else most_effects
    with streaming() as say:
        limit = TimeLimit(wall_s=within_s)
        return diagnose(twin, train, held, joints=joints, seed=seed, stream=say, most_effects=most, limit=limit)
