"""A change that no group of joints can have by itself, or that wear is not, diagnosed as that of any robot.

The earlier session's values are the model then, as sure as they are between two sessions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.changes.answer import Change, Valued
from twin_daemon.changes.group import Group
from twin_daemon.changes.thresholds import LEFT_OVER
from twin_daemon.comparison.split import hold_out
from twin_daemon.diagnosis.search import diagnose
from twin_daemon.diagnosis.verdict import Diagnosis, Finding
from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput
from twin_daemon.estimation.thresholds import Z95
from twin_daemon.processes import Say
from twin_daemon.processor_time import OutOfTime, TimeLimit
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.submodel import carried_by_all, linked
from twin_daemon.simulation.twin import TwinModel

_KINDS = ("damping", "frictionloss", "armature", "gain")


def changed_together(twin: TwinModel, groups: Sequence[Group]) -> list[list[Group]]:
    """Groups that carry each other and are off all at once, as under a load, with those that all of them carry.

    At least two in each are off.
    """
    off = [group for group in groups if group.strain > LEFT_OVER]
    found = []
    for members in linked(twin, [group.reduced.joints for group in off]) if off else []:
        own = [off[i] for i in members]
        beyond = carried_by_all(twin, [joint for group in own for joint in group.reduced.joints])
        if len(own) > 1:
            found.append([group for group in groups if group in own or set(group.reduced.joints) <= set(beyond)])
    return found


def diagnosed(
    twin: TwinModel,
    groups: Sequence[Group],
    now: Sequence[Aligned],
    held: Sequence[Aligned],
    spread: float,
    seed: int,
    say: Say,
    limit: TimeLimit,
) -> Diagnosis | None:
    """What is missing at some groups of the later session, with the earlier session's values; None if nobody can say.

    `spread` is one sigma of a parameter's logarithm between sessions. Raises OutOfTime where it was ended early.
    """
    try:
        train, judged = (list(now), list(held)) if held else hold_out(now)
    except BadInput:
        return None  # too short to be judged, too
    joints = [joint for group in groups for joint in group.reduced.joints]
    found = diagnose(
        _as_earlier(twin, groups, spread), train, judged, joints=joints, seed=seed, stream=say, limit=limit
    )
    if found.interrupted:
        raise OutOfTime
    return found if found.findings and found.verdict in ("explained", "ambiguous") else None


def _as_earlier(twin: TwinModel, groups: Sequence[Group], spread: float) -> TwinModel:
    """The twin with the values that the earlier session has, and the effects that it shows."""
    terms, parameters = twin.terms, dict(twin.terms.parameters)
    for group in groups:
        every = group.pair.now.quantities
        point = group.pair.means if group.start is None else group.start.point
        amounts = dict(zip((quantity.name for quantity in every), point, strict=False))
        shown = set(group.pair.now.active)
        if group.start is not None:
            sigmas = np.sqrt(np.diag(group.start.covariance))
            shown |= {i for i, q in enumerate(every) if q.signed and abs(point[i]) > Z95 * sigmas[i]}
        for index, quantity in enumerate(every):
            z = float(point[index])
            if quantity.is_parameter:
                parameters[quantity.name] = float(quantity.value(z) or 0.0)
            elif index in shown and not quantity.beside:
                beside = [one for one in every if one.beside == quantity.name]
                values = {one.parameter or "": one.value(float(amounts[one.name])) or 0.0 for one in beside}
                terms = terms.with_effect(quantity.term(z, values))
    known = twin.hand.description.nominal_uncertainty
    known = known.model_copy(update={kind: _share(groups, kind, spread) for kind in _KINDS})
    hand = replace(twin.hand, description=twin.hand.description.model_copy(update={"nominal_uncertainty": known}))
    return TwinModel(hand, twin.nominal, terms.model_copy(update={"parameters": parameters}))


def _share(groups: Sequence[Group], kind: str, spread: float) -> float:
    """How far parameters of a kind may be off: as sessions differ, and as the earlier one leaves its worst one open."""
    named = "kp" if kind == "gain" else kind
    open_by = [spread]
    for group in groups:
        if group.start is not None:
            sigmas = np.sqrt(np.diag(group.start.covariance))
            every = enumerate(group.pair.now.quantities)
            open_by += [float(np.hypot(spread, sigmas[i])) for i, q in every if q.name.endswith(f".{named}")]
    return min(max(open_by), 1.0)


def as_change(finding: Finding, first_seen: str) -> Change:
    """A finding of such a diagnosis as a change: there was none of it in the earlier session."""
    name = LIBRARY[finding.effect].presence[0]
    name = name if name in finding.parameters else next(iter(finding.parameters))
    now, unknown = finding.parameters[name], Valued(value=np.nan, ci95=(np.nan, np.nan))
    low, high = now.ci95 or (np.nan, np.nan)
    where, what = ", ".join(finding.joints), finding.effect.replace("_", " ")
    probability = 1.0 if finding.probability is None else finding.probability
    unit = f" {now.unit}" if now.unit != "1" else ""
    return Change(
        effect=finding.effect,
        parameter=f"{finding.name}.{name}",
        target=finding.target,
        joints=finding.joints,
        unit=now.unit,
        before=unknown,
        now=Valued(value=now.value, ci95=(low, high)),
        ratio=unknown,
        probability=probability,
        rivals=finding.confusable_with,
        first_seen=first_seen,
        words=f"{where}: {what} none -> {now.value:.3g}{unit} ({low:.3g} to {high:.3g}) by {first_seen[:10]}, "
        f"probability {probability:.2f}",
        remedy=LIBRARY[finding.effect].story.remedy,
    )
