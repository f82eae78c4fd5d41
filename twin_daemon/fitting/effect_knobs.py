"""Values of effects as knobs of a space: those that the twin has, and one that a space names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Parameter
from twin_daemon.errors import BadInput, nearest
from twin_daemon.fitting.knobs import Knob
from twin_daemon.simulation.twin import TwinModel


def knobs_of_effects(twin: TwinModel, moving: Sequence[str]) -> list[Knob]:
    """A knob for each value of the twin's effects that act on joints that move.

    Effects of the whole hand stay as they are: they would tie all of its parts into one search.
    """
    knobs = []
    for term in twin.terms.effects:
        joints = joints_of(twin, term.target)
        if joints & set(moving):
            for parameter in LIBRARY[term.effect].parameters:
                if not parameter.held:
                    start = term.values.get(parameter.name, parameter.default)
                    knobs.append(_knob(twin, term.effect, term.target, parameter, start, None))
    return knobs


def named_value_knobs(
    twin: TwinModel, kind: str, targets: Sequence[str], space: str, reach: float | None
) -> list[Knob]:
    """A knob at each target for one value of one effect, "effect.parameter"; the effect is neutral where it is new.

    `reach` bounds it to so much around where it is.
    """
    key, _, name = kind.partition(".")
    if key not in LIBRARY:
        raise BadInput(f"space '{space}': no effect '{key}'", todo=nearest(key, LIBRARY))
    known = {p.name: p for p in LIBRARY[key].parameters}
    if name not in known:
        raise BadInput(f"space '{space}': '{key}' has no parameter '{name}'", todo=nearest(name, known))
    if len(known) > 1:
        raise BadInput(f"space '{space}': '{key}' has {len(known)} parameters", todo="Add it first, and turn 'effects'")
    present = {(t.effect, t.target): t.values for t in twin.terms.effects}
    places = [t for t in targets if LIBRARY[key].applies(twin.place(t))]
    return [
        _knob(twin, key, t, known[name], present.get((key, t), {}).get(name, known[name].neutral), reach)
        for t in places
    ]


def joints_of(twin: TwinModel, target: str) -> set[str]:
    """The joints (names in the data) that an effect's target concerns; none for the whole hand."""
    if target in twin.joints:
        return {target}
    if target not in twin.actuators:
        return set()
    row = twin.drive[twin.actuators.index(target)]
    return {twin.joints[i] for i in np.flatnonzero(row)}


def _knob(twin: TwinModel, key: str, target: str, parameter: Parameter, start: float, reach: float | None) -> Knob:
    lower = parameter.lower if reach is None else max(parameter.lower, start - reach)
    upper = parameter.upper if reach is None else min(parameter.upper, start + reach)
    return Knob(
        name=f"{key}:{target}.{parameter.name}",
        unit=parameter.unit,
        lower=lower,
        upper=upper,
        start=float(min(max(start, lower), upper)),
        log=parameter.log and lower > 0,
        writes=(("effect", f"{key}:{target}", parameter.name),),
        joints=tuple(n for n in twin.joints if n in joints_of(twin, target)),
    )
