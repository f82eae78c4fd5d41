"""An effect that comes into the twin: its places, its fit, and the version of it."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from twin_daemon.errors import BadInput, nearest
from twin_daemon.places import ROBOT
from twin_daemon.workflows.diagnosis import train_and_held
from twin_daemon.workflows.session import Session, known_after, region_after, used
from twin_daemon.workflows.take_over import Taken

if TYPE_CHECKING:
    from twin_daemon.effects.base import Effect, Place
    from twin_daemon.estimation.estimate import Correlated
    from twin_daemon.estimation.uncertainty import Estimate
    from twin_daemon.simulation.alignment import Aligned
    from twin_daemon.simulation.terms import EffectTerm
    from twin_daemon.simulation.twin import TwinModel
    from twin_daemon.versions import Draft


def added_to(
    session: Session,
    effect: str,
    joint: Sequence[str],
    given: Mapping[str, float],
    recording: Sequence[Path] | None,
    holdout: Sequence[Path] | None,
    *,
    trajectory: str | None,
    taken: Taken | None = None,
) -> dict[str, Any]:
    """What the command writes of an effect that is fitted, or `taken` over; the version is stored."""
    kind = known_effect(effect)
    start = kind.complete(given)
    targets = effect_targets(session.twin, kind, joint)
    added = [_term(effect, target, start) for target in targets]
    changed = _changed(session.twin, added)
    fitted: dict[str, Estimate] = {}
    train, held, notes = data_of(session, recording, holdout, trajectory)
    joints = session.twin.joints_of_all(targets)
    if taken is not None:
        from twin_daemon.diagnosis.free_rollout import with_finding

        taken.verify([r.recording.sha256 for r in train], [r.recording.sha256 for r in held] if holdout else None)
        found, joints = taken.finding, taken.finding.joints
        changed = with_finding(session.twin, found)
        fitted = {f"{found.name}.{name}": one for name, one in found.parameters.items()}
        notes.append(f"taken over from {taken.path.name}: nothing was fitted anew")
    elif train and any(p.name not in given and not p.held for p in kind.parameters):
        from twin_daemon.diagnosis.refit import refit_effect

        refit = refit_effect(session.twin, train, kind, targets, given)
        changed, fitted = _changed(session.twin, refit.terms), refit.values
        changed = changed.changed(changed.terms.with_parameters(refit.parameters))
        notes += [*refit.notes, "the model's uncertain parameters there were refitted beside it, under their priors"]
    if kind.leaves_out:
        notes.append(kind.leaves_out)
    payload = {
        "effect": effect,
        "targets": targets,
        **errors(session.twin, changed, train, held, joints),
        **({"finding": taken.finding.model_dump(by_alias=True)} if taken is not None else {}),
        "parameters": {
            name: {"value": v.value, "unit": v.unit, "ci95": list(v.ci95), "at_bound": v.at_bound}
            for name, v in fitted.items()
        },
        "terms": changed.terms.as_json(),
    }
    draft = draft_of(session, changed, "effect_added", f"{effect} at {', '.join(targets)}", payload, train, held)
    stored = session.store.propose(draft, changed.mjcf())
    payload["version"], payload["candidate"] = stored.version.id, stored.candidate
    payload["parent"], payload["notes"] = session.version, notes
    return payload


def known_effect(key: str) -> Effect:
    """The effect of the library with this key. BadInput with the nearest one."""
    from twin_daemon.effects import LIBRARY, reload_files

    broken = reload_files()
    if key in broken:
        raise BadInput(f"'{key}' cannot be used: {broken[key]}")
    if key not in LIBRARY:
        raise BadInput(f"no effect '{key}'", todo=nearest_effect(key, list(LIBRARY)))
    return LIBRARY[key]


def nearest_effect(key: str, known: list[str]) -> str:
    """As `nearest`, also for half a key: 'stribek' is near to 'stribeck_friction'."""
    halves = {half: name for name in reversed(known) for half in (name, *name.split("_"))}
    close = difflib.get_close_matches(key, halves, n=1, cutoff=0.7)
    return f"Did you mean '{halves[close[0]]}'?" if close else nearest(key, known)


def effect_targets(twin: TwinModel, kind: Effect, joints: Sequence[str]) -> list[str]:
    """The twin's names of the places where the effect shall act. BadInput where it cannot, with where it can."""
    targets = []
    for name in joints:
        place = twin.place(name)
        if not kind.applies(place):
            raise BadInput(
                f"'{kind.key}' acts on {_acts_on(kind)}, not on '{place.target}'", todo=_hint(twin, kind, place)
            )
        targets.append(place.target)
    return [ROBOT] if ROBOT in targets else list(dict.fromkeys(targets))


def _acts_on(kind: Effect) -> str:
    return (
        "the whole hand" if kind.acts_on == "hand" else f"{'an' if kind.acts_on == 'actuator' else 'a'} {kind.acts_on}"
    )


def _hint(twin: TwinModel, kind: Effect, place: Place) -> str:
    if kind.acts_on == "hand":
        return "Give --joint hand"
    fitting = [n for n in dict.fromkeys([*twin.actuators, *twin.joints]) if kind.applies(twin.place(n))]
    related = {place.command, *(twin.driven[twin.actuators.index(place.command)] if place.command else ())}
    near = [name for name in fitting if name in related] or fitting
    if not near:
        return f"{twin.hand.name} has no place for it"
    return f"Give --joint {' or '.join(near[:4])}"


def _term(effect: str, target: str, values: Mapping[str, float]) -> EffectTerm:
    from twin_daemon.simulation.terms import EffectTerm

    return EffectTerm(effect=effect, target=target, values=dict(values))


def _changed(twin: TwinModel, added: Sequence[EffectTerm]) -> TwinModel:
    """The twin with these effects. BadInput where they cannot stand beside what it has."""
    terms = twin.terms
    for term in added:
        terms = terms.with_effect(term)
    return twin.changed(terms)


def data_of(
    session: Session, recording: Sequence[Path] | None, holdout: Sequence[Path] | None, trajectory: str | None
) -> tuple[list[Aligned], list[Aligned], list[str]]:
    """(recordings to fit, to judge by, notes); all empty where none are given."""
    if not recording:
        if holdout:
            raise BadInput("--holdout without --recording: nothing would be fitted", todo="Give --recording as well")
        return [], [], []
    return train_and_held(session, session.recordings(recording, trajectory), holdout, trajectory)


def errors(
    before: TwinModel, after: TwinModel, train: Sequence[Aligned], held: Sequence[Aligned], joints: Sequence[str]
) -> dict[str, dict[str, float | None]]:
    """Errors of the twin before and after a change: free roll-outs of the whole hand, and of some of its joints."""
    from twin_daemon.diagnosis.free_rollout import free_errors, mean_error

    held_before, held_after = (free_errors(twin, held, joints) for twin in (before, after))
    return {
        "before": {"mse_rad2": mean_error(before, train)},
        "after": {"mse_rad2": mean_error(after, train)},
        "holdout_before": {"mse_rad2": held_before[0]},
        "holdout_after": {"mse_rad2": held_after[0]},
        "holdout_joints_before": {"mse_rad2": held_before[1]},
        "holdout_joints_after": {"mse_rad2": held_after[1]},
    }


def draft_of(
    session: Session,
    changed: TwinModel,
    kind: str,
    title: str,
    payload: Mapping[str, Any],
    train: Sequence[Aligned],
    held: Sequence[Aligned],
    correlations: Sequence[Correlated] = (),
) -> Draft:
    """The version of a changed twin, with the errors and fitted values that a payload has."""
    from twin_daemon.versions import Draft, ParameterRecord

    names = ("before", "after", "holdout_before", "holdout_after", "clear_holdout_before", "clear_holdout_after")
    moving = [name for i, name in enumerate(changed.joints) if any(r.moving[i] for r in train)]
    parameters = {
        name: ParameterRecord(
            value=p["value"],
            unit=p["unit"],
            ci95=p["ci95"],
            at_bound=p.get("at_bound", False),
            identifiable=p.get("identifiability"),
        )
        for name, p in payload.get("parameters", {}).items()
    }
    return Draft(
        hand=session.hand.name,
        kind=kind,
        terms=changed.terms.as_json(),
        parent=session.version,
        title=title,
        parameters=parameters,
        posterior=known_after(session, parameters, correlations),
        fitted_on=used(train),
        held_out_on=used(held),
        seed=payload.get("seed"),
        region=region_after(session, changed, train),
        errors={**{name: payload[name] for name in names if name in payload}, "joints": moving} if train else {},
    )
