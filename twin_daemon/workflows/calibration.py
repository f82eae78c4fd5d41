"""Fitting parameters to recordings, and what is stored and said of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from twin_daemon.workflows.data_check import warn_before_fit
from twin_daemon.workflows.progress import progress_bar
from twin_daemon.workflows.session import Session, held_out, known_after, region_after, remembered, used

if TYPE_CHECKING:
    from twin_daemon.calibration.calibrate import Calibration
    from twin_daemon.estimation.uncertainty import Estimate
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.versions import Proposed


def calibrated(
    session: Session,
    train: list[Aligned],
    held: list[Aligned],
    search: str,
    space: str,
    budget: int | None,
    seed: int,
    cluster: str | None = None,
) -> tuple[dict[str, Any], Calibration]:
    """(what the command writes, the same as values); the version is stored."""
    from twin_daemon.calibration.calibrate import calibrate
    from twin_daemon.calibration.spaces import load_space
    from twin_daemon.executor import on_cluster

    chosen = load_space(space)
    warnings = warn_before_fit(session, train)
    train, held, notes = held_out(train, held)
    with on_cluster(cluster), progress_bar(f"{search} over '{chosen.name}'", budget) as report:
        result = calibrate(
            session.twin,
            train,
            held,
            chosen,
            search,
            budget=budget,
            seed=seed,
            progress=report,
            remembered=remembered(session),
        )
    if result.not_fitted:
        notes.append(
            f"left as they are, since their parts touch something nearly all the time: {', '.join(result.not_fitted)}. "
            "Record them clear of each other"
        )
    stored = _store(session, result, train, held, chosen.name, search, budget, seed)
    return _payload(result, stored, [*warnings, *notes], chosen.name, search, seed), result


def _store(
    session: Session,
    result: Calibration,
    train: list[Aligned],
    held: list[Aligned],
    space: str,
    search: str,
    budget: int | None,
    seed: int,
) -> Proposed:
    """Stores the calibration, as the candidate where it is better."""
    from twin_daemon.versions import Draft, ParameterRecord

    twin = session.twin.changed(result.terms)
    parameters = {
        name: ParameterRecord(
            value=p.value,
            unit=p.unit,
            lower=p.lower,
            upper=p.upper,
            at_bound=p.at_bound,
            ci95=p.ci95,
            identifiable=p.identifiable,
        )
        for name, p in result.parameters.items()
    }
    draft = Draft(
        hand=session.hand.name,
        kind="calibrated",
        terms=result.terms.as_json(),
        parent=session.version,
        title=f"{search} over '{space}'",
        parameters=parameters,
        posterior=known_after(session, parameters, result.correlations),
        fitted_on=used(train),
        held_out_on=used(held),
        errors=_errors_to_keep(result),
        region=region_after(session, twin, train),
        search={"name": search, "space": space, "budget": budget, "evaluations": result.evaluations},
        seed=seed,
    )
    return session.store.propose(draft, twin.mjcf())


def errors(result: Calibration) -> dict[str, Any]:
    """Errors before and after, on what was fitted and on what was held out."""
    return {
        "before": {"mse_rad2": result.before_rad2},
        "after": {"mse_rad2": result.after_rad2},
        "holdout_before": {"mse_rad2": result.holdout_before_rad2},
        "holdout_after": {"mse_rad2": result.holdout_after_rad2},
    }


def _errors_to_keep(result: Calibration) -> dict[str, Any]:
    """What a version keeps: the errors, the joints they are of, and those of its parent where it began elsewhere."""
    found = {**errors(result), "joints": list(result.objective)}
    if result.given_rad2 == result.before_rad2 and result.holdout_given_rad2 == result.holdout_before_rad2:
        return found
    given = {"mse_rad2": result.given_rad2}
    return {**found, "given": given, "holdout_given": {"mse_rad2": result.holdout_given_rad2}}


def _payload(
    result: Calibration, stored: Proposed, notes: list[str], space: str, search: str, seed: int
) -> dict[str, Any]:
    return {
        **errors(result),
        "objective": result.objective,
        "search": search,
        "space": space,
        "seed": seed,
        "evaluations": result.evaluations,
        "wall_s": result.wall_s,
        "interrupted": result.interrupted,
        "onset_s": result.onsets_s,
        "parameters": fitted_values(result.parameters),
        "history": result.history,
        "version": stored.version.id,
        "candidate": stored.candidate,
        "notes": notes,
    }


def fitted_values(parameters: Mapping[str, Estimate]) -> dict[str, dict[str, Any]]:
    """Fitted parameters by name, as the contract spells them."""
    return {
        name: {
            "value": p.value,
            "unit": p.unit,
            "lower": p.lower,
            "upper": p.upper,
            "at_bound": p.at_bound,
            "ci95": list(p.ci95),
            "identifiable": p.identifiable == "identifiable",
            "identifiability": p.identifiable,
            "confused_with": p.confused_with,
        }
        for name, p in parameters.items()
    }
