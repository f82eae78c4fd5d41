"""The proposals for a twin: which joints are looked at, when nothing is proposed, and what is said of what is."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from twin_daemon.diagnosis.free_rollout import with_finding
from twin_daemon.diagnosis.verdict import Diagnosis, Trial
from twin_daemon.effects import reload_files
from twin_daemon.effects.from_files import EffectFile, save_effect_file
from twin_daemon.effects.from_files import native as native_form
from twin_daemon.effects.from_files.schema import STEEPEST_READING, steepest
from twin_daemon.errors import BadInput
from twin_daemon.estimation.partition import Reduction
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE, Z95
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit
from twin_daemon.proposals.joint_laws import FoundLaw, laws_of_joint
from twin_daemon.proposals.proposal import Curve, Native, Nearest, Proposal, Proposals, Rival, Value
from twin_daemon.proposals.refit import MEMORY_UNITS, RefittedLaw
from twin_daemon.proposals.search import FittedLaw, JointSearch
from twin_daemon.proposals.thresholds import (
    LEAST_GAIN,
    LIBRARY_LEAVES,
    MOST_NULL,
    NEAREST_SHOWN,
)
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

_X_UNITS = {
    "velocity": "rad/s",
    "neighbour_velocity": "rad/s",
    "acceleration": "rad/s2",
    "load": "N m",
    "time": "s",
    "heat": "1",
}


def propose(
    twin: TwinModel,
    train: Sequence[Aligned],
    holdout: Sequence[Aligned],
    found: Diagnosis,
    *,
    joints: Sequence[str] | None = None,
    seed: int = 0,
    stream: Say | None = None,
    limit: TimeLimit | None = None,
    further: Callable[[], Diagnosis] | None = None,
) -> Proposals:
    """The law that a diagnosis has not found: searched only where it says `unexplained`.

    With `joints` at each of them, else at the one whose error is worst over its floor. Each proposal is written as an
    effect file into the state folder.

    A diagnosis that has not asked for several effects at a joint may be given with what goes on to them: it does so
    where laws do not account for all of the error, and what it finds then is the answer.
    """
    say, limit = stream or (lambda _: None), limit or TimeLimit()
    if found.verdict != "unexplained":
        return Proposals(verdict=found.verdict, reason=_closed(found))
    chosen = list(joints) if joints else _worst(found, moving_joints(train))
    if not chosen:
        return Proposals(verdict=found.verdict, reason="no joint is above its floor")
    base, notes = _with_findings(twin, found, chosen)
    reduction = Reduction(base, train, holdout)

    def refused(search: JointSearch, law: RefittedLaw) -> str:
        return _refused(search, law, found)

    laws: list[FoundLaw] = []
    tried: list[Rival] = []
    reasons: list[str] = []
    all_of_it = True
    for joint in chosen:
        part = next(g for g in drive_groups(base) if joint in g.joints)
        search = JointSearch(base, reduction, part, joint, train, holdout, seed=seed, say=say, limit=limit)
        if search.reduced is None:
            reasons.append(f"{joint} does not move clear of contacts for long enough")
            continue
        if search.actuator is None:
            reasons.append(f"no servo of the model drives {joint}")
            continue
        if search.within_floor:
            reasons.append(f"{joint} is at its floor: {search.times_floor:.1f} times it")
            continue
        own, why, rivals = laws_of_joint(search, refused)
        tried += rivals
        laws += own
        all_of_it = all_of_it and bool(own) and own[-1].law.law.chi_square <= FLOOR_CHI_SQUARE
        if not own:
            reasons.append(f"{joint}: {why}")
    if further is not None and laws and all_of_it:
        notes.append(
            "several effects of the library at one joint were not asked for: what is proposed leaves its floor"
        )
    elif further is not None:
        found = further()
        if found.verdict != "unexplained":
            return Proposals(verdict=found.verdict, reason=_closed(found), tried=tuple(tried))
    proposals = [_proposal(one, found) for one in laws]
    if proposals:
        reason = "; ".join(f"{p.name}: {p.port} over {' x '.join(p.variables)} at {p.joints[0]}" for p in proposals)
    else:
        reason = "; ".join(reasons)
    return Proposals(
        verdict=found.verdict, reason=reason, proposals=tuple(proposals), tried=tuple(tried), notes=tuple(notes)
    )


def _closed(found: Diagnosis) -> str:
    if found.verdict == "within_noise":
        return "nothing is missing that these data show: the error is at its floor"
    if found.verdict == "not_excited":
        return f"this motion cannot show what is missing: {found.reason}"
    return f"effects of the library account for the error: {found.reason}"


def _worst(found: Diagnosis, moving: Sequence[str]) -> list[str]:
    """The moving joint of the part that is furthest over its floor with all that was found."""
    above = [part for part in found.parts.values() if not part.within_floor or part.left_times_floor > 1.0]
    above.sort(key=lambda part: -part.left_times_floor)
    for part in above:
        own = [name for name in part.joints if name in moving]
        if own:
            at = [row.joint for row in found.where if row.joint in own]
            return [at[0] if at else own[0]]
    return []


def _with_findings(twin: TwinModel, found: Diagnosis, chosen: Sequence[str]) -> tuple[TwinModel, list[str]]:
    """The twin with what the diagnosis found at other joints; what it tried here is to be outdone, not built upon."""
    notes = []
    for finding in found.findings:
        if set(finding.joints) & set(chosen):
            continue
        try:
            twin = with_finding(twin, finding)
            notes.append(f"{finding.name} was found beside it, and is in the model here")
        except BadInput:  # it stands only beside the others
            continue
    return twin, notes


def _refused(search: JointSearch, described: RefittedLaw, found: Diagnosis) -> str:
    """Why the best law is not proposed; empty where it is."""
    law = described.law
    low, high = law.gain_ci95
    if law.feature.port == "reading" and law.feature.over == "position":
        slope = steepest(described.knots, described.curve)
        if slope > STEEPEST_READING:
            return f"the best law ({law.feature.name}) is a reading that turns back: {slope:.2f} of the angle's own"
    if low <= 0.0:
        return f"on held-out motion the best law ({law.feature.name}) gains {law.gain:.0%} ({low:.0%} to {high:.0%})"
    if law.gain < LEAST_GAIN:
        return f"the best law ({law.feature.name}) takes {law.gain:.0%} of the held-out error away, too little"
    if (null := search.null_share(law.trial)) > MOST_NULL:
        return f"errors moved in time fit {law.feature.name} as well in {null:.0%} of draws"
    if (known := _library_leaves_less(search, law, found)) is not None:
        return f"the library's {known.effect} leaves less, of this motion and of held-out motion"
    return ""


def _library_leaves_less(search: JointSearch, law: FittedLaw, found: Diagnosis) -> Trial | None:
    """An effect of the library at this joint that leaves clearly less of both motions than a law; None without one.

    Of the fitted motion in floors, with the price of what is off beside it: with that far off, and on held-out motion
    after a step of its values there, an effect that is wrong may leave less than a law that is right.
    """
    for trial in found.tried:
        if trial.target != search.joint or trial.holdout_mse_rad2 is None or trial.left_times_floor is None:
            continue
        fitted = trial.left_times_floor < LIBRARY_LEAVES * law.chi_square
        if fitted and trial.holdout_mse_rad2 < LIBRARY_LEAVES * law.mse_after:
            return trial
    return None


def _proposal(one: FoundLaw, found: Diagnosis) -> Proposal:
    search, law = one.search, one.law
    fitted, feature = law.law, law.law.feature
    null = search.null_share(fitted.trial)
    probability = one.probability * (1.0 - null)
    file = _file(search, law, probability)
    path = save_effect_file(file)
    reload_files()
    at_unit = MEMORY_UNITS.get(feature.memory) or _X_UNITS.get(feature.over, "rad")
    band = Z95 * law.sigmas
    costs = native_form.cost(file)
    curve = Curve(
        at=law.knots,
        at_unit=at_unit,
        value=tuple(law.curve),
        lower=tuple(law.curve - band),
        upper=tuple(law.curve + band),
        unit=feature.unit,
        visited=file.visited,
    )
    return Proposal(
        name=file.name,
        port=feature.port,
        variables=feature.variables,
        joints=(search.joint,),
        formula=law.text,
        parameters={n: Value(value=v, ci95=(low, high)) for n, (v, low, high) in law.values.items()},
        curve=curve,
        holdout_mse_before=fitted.mse_before,
        holdout_mse_after=fitted.mse_after,
        holdout_gain=fitted.gain,
        holdout_gain_ci95=fitted.gain_ci95,
        probability=probability,
        null_probability=null,
        evidence=fitted.nats,
        nearest=_nearest(found, search.joint),
        native=Native(exact=not costs, cost=costs, holdout_gain=_native_gain(search, file)),
        experiment=_experiment(feature.over, feature.memory, file.visited),
        file=str(path),
    )


def _nearest(found: Diagnosis, joint: str) -> tuple[Nearest, ...]:
    here = sorted((t for t in found.tried if t.target == joint), key=lambda t: -t.evidence_nats)[:NEAREST_SHOWN]
    out = [Nearest(effect=f"{t.effect}:{t.target}", fails_because=t.lost_because) for t in here]
    return tuple(
        [Nearest(effect=f.name, fails_because="with it the error is still unexplained") for f in found.findings
         if joint in f.joints] + out
    )  # fmt: skip


def _file(search: JointSearch, law: RefittedLaw, probability: float) -> EffectFile:
    fitted, feature = law.law, law.law.feature
    knots = fitted.trial.feature.knots
    visited = (0.0, 0.0) if feature.memory else (float(knots[0]), float(knots[-1]))
    content: dict[str, Any] = {
        "schema": 1,
        "name": "proposed",
        "title": f"{_AT[feature.port]} that depends on {' times '.join(feature.variables)}",
        "port": feature.port,
        "over": feature.over,
        "factor": feature.factor,
        "memory": feature.memory,
        "neighbour": feature.neighbour,
        "unit": feature.unit,
        "knots": [float(x) for x in law.knots],
        "values": [float(v) for v in law.curve],
        "sigmas": [float(min(s, 1e5)) for s in law.sigmas],
        "visited": visited,
        "formula": law.text,
        "formula_values": {n: [float(np.clip(x, -1e6, 1e6)) for x in v] for n, v in law.values.items()},
        "found_at": search.joint,
        "evidence": {"holdout_gain": fitted.gain, "probability": probability},
        "recordings": sorted({r.recording.sha256 for r in (*search.train, *search.holdout)}),
    }
    digest = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:8]
    words = [feature.port, feature.memory or feature.over, *([feature.factor] if feature.factor else [])]
    return EffectFile.model_validate(content | {"name": f"proposed_{'_'.join(words)}_{digest}"})


_AT = {"torque": "a torque", "command": "a change of what the servo gives", "reading": "a change of the reading"}


def _native_gain(search: JointSearch, file: EffectFile) -> float | None:
    """What the plain MJCF with this effect takes away of the held-out error; None where it cannot be built.

    Nor where it depends on a neighbour, which the part that is judged does not have.
    """
    assert search.reduced is not None
    if file.neighbour:
        return None
    small = search.reduced.twin
    place = search.joint if file.port != "command" else small.actuators[search.actuator or 0]
    try:
        changed = small.changed(small.terms.with_effect(EffectTerm(effect=file.name, target=place, values={})))
    except BadInput:
        return None
    return search.gain_of(changed)


def _experiment(over: str, memory: str, visited: tuple[float, float]) -> str:
    low, high = visited
    if memory in ("lag", "slew"):
        return "steps and ramps of the command at several speeds, with the command's own stamps recorded"
    if memory:
        return "steps to several sizes, each held for a minute and then taken back, and small reversals between"
    return {
        "position": f"slow sweeps both ways over {low:.2f} to {high:.2f} rad and beyond, at two speeds",
        "velocity": "the same travel at five speeds from creeping to fastest, both ways",
        "acceleration": "the same travel by steps and by slow ramps",
        "orientation": "the same travel with the joints before it in three other poses",
        "load": "the same travel against a weight and without it, both ways",
        "neighbour_velocity": "the neighbour at three speeds while this joint holds, then this joint alone",
        "time": "the same motion from cold, and again after a rest: does it begin anew?",
        "heat": "hard work for a minute, then rest, with the same slow test motion before and after",
        "command": "targets all over the range, approached from both sides",
        "error": "small steps of growing size from rest, and the same against a weight",
        "neighbour": "the neighbour alone over its range while this joint holds, then this joint alone",
    }[over]
