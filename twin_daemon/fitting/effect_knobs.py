"""Values of effects as knobs of a space: those that the twin has, and one that a space names."""

from __future__ import annotations

from collections.abc import Sequence

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
        joints = twin.joints_of(term.target)
        if set(joints) & set(moving):
            for p in LIBRARY[term.effect].parameters:
                if not p.held:
                    start = term.values.get(p.name, p.default)
                    knobs.append(value_knob(term.effect, term.target, p, (p.lower, p.upper), start, joints))
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
    parameter = known[name]
    present = {(t.effect, t.target): t.values for t in twin.terms.effects}
    knobs = []
    for target in targets:
        if LIBRARY[key].applies(twin.place(target)):
            start = present.get((key, target), {}).get(name, parameter.neutral)
            lower = parameter.lower if reach is None else max(parameter.lower, start - reach)
            upper = parameter.upper if reach is None else min(parameter.upper, start + reach)
            knobs.append(value_knob(key, target, parameter, (lower, upper), start, twin.joints_of(target)))
    return knobs


def value_knob(
    key: str, target: str, parameter: Parameter, bounds: tuple[float, float], start: float, joints: tuple[str, ...] = ()
) -> Knob:
    """One value of an effect at its target as a dimension of a search, within bounds in the parameter's unit."""
    lower, upper = bounds
    return Knob(
        name=f"{key}:{target}.{parameter.name}",
        unit=parameter.unit,
        lower=lower,
        upper=upper,
        start=float(min(max(start, lower), upper)),
        log=parameter.log and lower > 0,
        writes=(("effect", f"{key}:{target}", parameter.name),),
        joints=joints,
    )
