"""A change that no group of joints can have by itself, or that wear is not, diagnosed as that of any robot.

The earlier session's values are the model then, as sure as they are between two sessions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.changes.answer import UNKNOWN, Change, Valued, sentence
from twin_daemon.changes.group import Group
from twin_daemon.changes.quantities import term_of
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


def changed_together(twin: TwinModel, groups: Sequence[Group]) -> list[list[Group]]:
    """Groups that carry each other and are off all at once, as under a load, with those that all of them carry.

    At least two in each are off.
    """
    off = [group for group in groups if group.without.strain > LEFT_OVER]
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
    # what is held out of the same motion has the same values
    earlier = _as_earlier(twin, groups, min(spread, 1.0), between_sessions=min(spread, 1.0) if held else 0.0)
    found = diagnose(earlier, train, judged, joints=joints, seed=seed, stream=say, limit=limit)
    if found.interrupted:
        raise OutOfTime
    return found if found.findings and found.verdict in ("explained", "ambiguous") else None


def _as_earlier(twin: TwinModel, groups: Sequence[Group], spread: float, between_sessions: float) -> TwinModel:
    """The twin with the values that the earlier session has, and the effects that it shows."""
    terms, parameters = twin.terms, dict(twin.terms.parameters)
    shares: dict[str, float] = {}
    for group in groups:
        every = group.pair.now.quantities
        point = group.pair.means if group.start is None else group.start.point
        shown = set(group.pair.now.active)
        sigmas = np.zeros(len(every))
        if group.start is not None:
            sigmas = np.sqrt(np.diag(group.start.covariance))
            shown |= {i for i, q in enumerate(every) if q.signed and abs(point[i]) > Z95 * sigmas[i]}
        for index, quantity in enumerate(every):
            if quantity.is_parameter:
                parameters[quantity.name] = float(quantity.value(float(point[index])) or 0.0)
                shares[quantity.name] = min(float(np.hypot(spread, sigmas[index])), 1.0)
            elif index in shown and not quantity.beside:
                terms = terms.with_effect(term_of(every, index, point))
    # as sessions differ, and as the earlier one leaves them open
    kinds = dict.fromkeys(("damping", "frictionloss", "armature", "gain"), spread)
    own = {**kinds, "parameters": shares, "between_sessions": between_sessions}
    known = twin.hand.description.nominal_uncertainty.model_copy(update=own)
    hand = replace(twin.hand, description=twin.hand.description.model_copy(update={"nominal_uncertainty": known}))
    return TwinModel(hand, twin.nominal, terms.model_copy(update={"parameters": parameters}))


def as_change(finding: Finding, first_seen: str) -> Change:
    """A finding of such a diagnosis as a change: there was none of it in the earlier session."""
    name = LIBRARY[finding.effect].presence[0]
    name = name if name in finding.parameters else next(iter(finding.parameters))
    value, unit = finding.parameters[name], finding.parameters[name].unit
    now = Valued(value=value.value, ci95=value.ci95)
    probability = 1.0 if finding.probability is None else finding.probability
    return Change(
        effect=finding.effect,
        parameter=f"{finding.name}.{name}",
        target=finding.target,
        joints=finding.joints,
        unit=unit,
        before=UNKNOWN,
        now=now,
        ratio=UNKNOWN,
        probability=probability,
        rivals=finding.confusable_with,
        first_seen=first_seen,
        words=sentence(finding.effect, finding.joints, unit, UNKNOWN, now, UNKNOWN, first_seen, probability),
        remedy=LIBRARY[finding.effect].story.remedy,
    )
