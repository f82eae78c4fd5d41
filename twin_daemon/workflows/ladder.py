"""One named effect after another, and the version that comes of it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_daemon.workflows.calibration import fitted_values
from twin_daemon.workflows.change import draft_of
from twin_daemon.workflows.diagnosis import train_and_held
from twin_daemon.workflows.progress import streaming
from twin_daemon.workflows.session import Session

if TYPE_CHECKING:
    from twin_daemon.diagnosis.stepwise import Ladder
    from twin_daemon.simulation.alignment import Aligned


def laddered(
    session: Session,
    whole: list[Aligned],
    holdout: Sequence[Path] | None,
    trajectory: str | None,
    max_steps: int,
    seed: int,
    cluster: str | None = None,
    within_s: float | None = None,
) -> tuple[dict[str, Any], Ladder]:
    """(what the command writes, the same as values); the version is stored."""
    from twin_daemon.diagnosis.stepwise import stepwise
    from twin_daemon.executor import on_cluster
    from twin_daemon.processor_time import TimeLimit

    train, held, notes = train_and_held(session, whole, holdout, trajectory)
    began = time.perf_counter()
    with on_cluster(cluster), streaming() as say:
        ladder = stepwise(
            session.twin,
            train,
            held,
            max_steps=max_steps,
            whole=() if holdout else whole,
            limit=TimeLimit(wall_s=within_s),
            fitted_after=True,
            seed=seed,
            say=say,
        )
    if ladder.ended_early and within_s is not None:
        notes.append(f"looking for effects ended after {within_s:g} s: give it more time (--within) to look on")
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
    """(the version with all effects, whether it is the candidate); where nothing has changed the one at the start."""
    added = [f"{step.effect} at {step.target}" for step in ladder.steps if step.effect is not None]
    if len(ladder.steps) < 2:
        return session.version, False
    first, last, judged = ladder.steps[0], ladder.steps[-1], ladder.last_judged
    errors = {
        "before": {"mse_rad2": first.mse_rad2},
        "after": {"mse_rad2": last.mse_rad2},
        "holdout_before": {"mse_rad2": first.holdout_mse_rad2},
        "holdout_after": {"mse_rad2": judged.holdout_mse_rad2},
    }
    fitted = {"parameters": payload["parameters"]}
    title = "ladder: " + (", ".join(added) or "values alone")
    kind = "effect_added" if added else "calibrated"
    draft = draft_of(session, ladder.twin, kind, title, {**errors, "seed": seed, **fitted}, train, held)
    stored = session.store.propose(draft, ladder.twin.mjcf())
    return stored.version.id, stored.candidate
