"""Fitting the version in use to what the hand does now, and deciding whether the result is better."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from twin_daemon.workflows.calibration import fitted_values
from twin_daemon.workflows.change import draft_of
from twin_daemon.workflows.progress import progress_bar, progress_console
from twin_daemon.workflows.session import Session, held_out, remembered

if TYPE_CHECKING:
    from twin_daemon.estimation.estimate import Estimate
    from twin_daemon.recalibration.recalibrate import Recalibration
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.simulation.twin import TwinModel


def recalibrated(
    session: Session,
    train: list[Aligned],
    held: list[Aligned],
    joints: Sequence[str],
    budget: int | None,
    within: float | None,
    seed: int,
    promote: bool,
) -> tuple[dict[str, Any], Recalibration]:
    """(what the command writes, the same as values); the version is stored, and promoted where that is asked for and
    it is better."""
    from twin_daemon.recalibration.recalibrate import recalibrate

    train, held, notes = held_out(train, held)
    began = time.monotonic()
    console = progress_console()
    with progress_bar("Bayesian search over 'wear'", budget) as report:
        found = recalibrate(
            session.twin,
            train,
            held,
            promised_rad2=_promised(session),
            joints=joints,
            budget=budget,
            seconds=within,
            seed=seed,
            progress=report,
            say=lambda line: console.print(line, markup=False, emoji=False),
            remembered=remembered(session),
        )
    payload = _payload(session, found, held, notes, seed)
    together = found.calibration.correlations if found.ladder is None else ()
    draft = draft_of(session, found.twin, "recalibrated", _title(found), payload, train, held, together)
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
    return payload, found


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
        "changed": changed_in_words(session.twin, found.parameters),
        "verdict": None if found.ladder is None else found.ladder.last_judged.verdict,
        "parameters": fitted_values(found.parameters),
        "evaluations": fitted.evaluations,
        "interrupted": fitted.interrupted,
        "notes": notes,
        "seed": seed,
    }


def changed_in_words(before: TwinModel, parameters: Mapping[str, Estimate]) -> list[str]:
    """The model's numbers that have left where they were by more than their intervals, the greatest change first."""
    from twin_daemon.simulation.parameters import KINDS

    said: list[tuple[float, str]] = []
    for name, one in parameters.items():
        if ":" in name or name.rpartition(".")[2] not in KINDS:
            continue
        was = before.parameter(name).read(before.model)
        if was <= 0.0 or one.value <= 0.0 or one.ci95[0] <= was <= one.ci95[1]:
            continue
        percent, low, high = (f"{100.0 * (value / was - 1.0):+.0f}" for value in (one.value, *one.ci95))
        said.append((abs(math.log(one.value / was)), f"{name} {percent} % ({low} to {high} %)"))
    return [text for _, text in sorted(said, reverse=True)]
