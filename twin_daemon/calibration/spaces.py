"""Search spaces as data: which parameters a calibration may move, how far, and from where."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal

import yaml
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput, nearest
from twin_daemon.estimation.thresholds import (
    ZERO_START_FACTOR,
)
from twin_daemon.estimation.variables import (
    EffectVariable,
    ParameterVariable,
    Remembered,
    Variable,
    anchored,
    effect_variable,
)
from twin_daemon.simulation.parameters import KINDS, ParameterKind
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.yaml_files import load_yaml

_FOLDER = Path(__file__).parent / "data"


class SpaceEntry(BaseModel):
    """One line of a space: a kind of parameter and where it is."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    kind: str = Field(description="a kind of parameter; 'effects' for all that the twin has; 'effect.value' for one")
    of: list[str] = Field(description="groups, joints, commands or bodies; 'moving' and 'driving' follow the data")
    share: bool = Field(default=False, description="one value for all of a group instead of one for each member")
    lower: float | None = None
    upper: float | None = None
    within: float | None = Field(default=None, gt=0, description="+- this fraction of the start, instead of bounds")
    reach: float | None = Field(default=None, gt=0, description="+- this much of the start, in the kind's unit")
    start: float | None = Field(default=None, description="instead of the model's own value")


class Space(BaseModel):
    """A search space. `objective` are the joints or groups whose error counts; the moving joints if empty."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    format: Literal[1] = Field(alias="schema")
    name: str
    about: str
    objective: list[str] = []
    anchor_rad: float = Field(
        default=0.0, ge=0.0, description="error that has to be gained to take a value by its own size from its start"
    )
    parameters: list[SpaceEntry]


def space_names() -> list[str]:
    """The spaces that come with the program."""
    return sorted(path.stem for path in _FOLDER.glob("*.yaml"))


def load_space(space: str) -> Space:
    """A space by name, or from a YAML file. Raises BadInput saying which key is wrong."""
    path = _FOLDER / f"{space}.yaml" if space in space_names() else Path(space)
    if not path.is_file():
        raise BadInput(f"no space '{space}'", todo=nearest(space, space_names()) + ", or give a YAML file")
    try:
        return Space.model_validate(load_yaml(path.read_text()))
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadInput(f"not readable as YAML: {error}", where=path) from None
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"])
        raise BadInput(f"{where}: {first['msg']}", where=path, allowed="the keys of the spaces in docs/") from None


def variables_of(
    space: Space, twin: TwinModel, moving: tuple[str, ...], remembered: Mapping[str, Remembered] | None = None
) -> tuple[Variable, ...]:
    """The variables of a space on one twin; `moving` are the joints that move in the data.

    A space that anchors them does so by what is `remembered` of each, by its name, where that is known.
    """
    variables: list[Variable] = []
    for entry in space.parameters:
        if entry.kind == "effects":
            variables += _of_effects(twin, [n for item in entry.of for n in _named(item, twin, moving)])
            continue
        if "." in entry.kind:
            targets = [n for item in entry.of for n in _named(item, twin, moving)]
            new = _of_named_value(twin, entry.kind, targets, space.name, entry.reach)
            variables += [v for v in new if v.name not in {known.name for known in variables}]
            continue
        if entry.kind not in KINDS:
            raise BadInput(f"space '{space.name}': no parameter kind '{entry.kind}'", todo=nearest(entry.kind, KINDS))
        kind = KINDS[entry.kind]
        for label, members in _members(entry, kind, twin, moving):
            if members:
                variables.append(_variable(entry, kind, twin, label, members, space.name))
    if space.anchor_rad:
        known = remembered or {}
        variables = [anchored(variable, known.get(variable.name)) for variable in variables]
    if not variables:
        raise BadInput(f"space '{space.name}' moves nothing in this model", allowed="joints, groups and commands of it")
    return tuple(variables)


def objective_of(space: Space, twin: TwinModel, moving: tuple[str, ...]) -> tuple[str, ...]:
    """The joints whose error the space minimises: its own list where that moves, else all that move."""
    groups = twin.hand.description.groups
    wanted = [j for item in space.objective for j in groups.get(item, [item])]
    chosen = tuple(j for j in moving if not wanted or j in wanted)
    if not chosen:
        raise BadInput(
            f"no joint of space '{space.name}' moves in this recording", todo="Record a motion of its joints"
        )
    return chosen


def _of_effects(twin: TwinModel, moving: Sequence[str]) -> list[EffectVariable]:
    """A variable for each value of the twin's effects that act on joints that move.

    Effects of the whole hand stay as they are, and those that are one for all servos: they would tie all of its parts
    into one search. Their ranges are those of the model as it is described: a gain that the motion hardly shows may
    have been fitted to fifty times that.
    """
    variables, described = [], twin.changed(Terms())
    for term in twin.terms.effects:
        joints = twin.joints_of(term.target)
        if set(joints) & set(moving) and not twin.terms.is_everywhere(term, twin.actuators, twin.joints):
            bounds = LIBRARY[term.effect].bounds(described.scale(term.target))
            for p in LIBRARY[term.effect].parameters:
                lower, upper = bounds[p.name]
                if lower < upper and not (p.held or p.refines) and p.name != LIBRARY[term.effect].everywhere:
                    start = term.values.get(p.name, p.default)
                    reach = min(lower, start), max(upper, start)
                    variables.append(effect_variable(term.effect, term.target, p, reach, start, joints))
    return variables


def _of_named_value(
    twin: TwinModel, kind: str, targets: Sequence[str], space: str, reach: float | None
) -> list[EffectVariable]:
    """A variable at each target for one value of one effect, "effect.parameter"; the effect is neutral where it is new.

    `reach` bounds it to so much around where it is.
    """
    key, _, name = kind.partition(".")
    if key not in LIBRARY:
        raise BadInput(f"space '{space}': no effect '{key}'", todo=nearest(key, LIBRARY))
    known = {p.name: p for p in LIBRARY[key].parameters}
    if name not in known:
        raise BadInput(f"space '{space}': '{key}' has no parameter '{name}'", todo=nearest(name, known))
    if len(known) > 1:
        raise BadInput(f"space '{space}': '{key}' has {len(known)} parameters", todo="Add it first, and fit 'effects'")
    parameter = known[name]
    present = {(t.effect, t.target): t.values for t in twin.terms.effects}
    variables = []
    for target in targets:
        if LIBRARY[key].applies(twin.place(target)):
            start = present.get((key, target), {}).get(name, parameter.neutral)
            lower, upper = parameter.bounds(twin.scale(target if target != "hand" else twin.joints[0]))
            if reach is not None:
                lower, upper = max(lower, start - reach), min(upper, start + reach)
            variables.append(effect_variable(key, target, parameter, (lower, upper), start, twin.joints_of(target)))
    return variables


def _members(
    entry: SpaceEntry, kind: ParameterKind, twin: TwinModel, moving: tuple[str, ...]
) -> list[tuple[str, list[str]]]:
    """(label, parameters that it moves) of each variable of an entry."""
    out: list[tuple[str, list[str]]] = []
    for item in entry.of:
        names = [n for n in _named(item, twin, moving) if kind.element == "body" or _has(kind, n, twin)]
        if kind.element in ("joint", "tendon") and item in twin.hand.description.groups:
            names = [n for n in names if n in moving]
        if entry.share:
            out.append((f"{item}.{kind.key}", [f"{n}.{kind.key}" for n in names]))
        else:
            out.extend((f"{n}.{kind.key}", [f"{n}.{kind.key}"]) for n in names)
    return out


def _named(item: str, twin: TwinModel, moving: tuple[str, ...]) -> list[str]:
    """What one word of `of` stands for: 'moving', 'driving', 'bodies', a group, or itself."""
    if item == "moving":
        return list(moving)
    if item == "driving":
        columns = [twin.joints.index(joint) for joint in moving]
        return [name for name, row in zip(twin.actuators, twin.drive, strict=True) if row[columns].any()]
    if item == "bodies":
        return _moved_bodies(twin, moving)
    return list(twin.hand.description.groups.get(item, [item]))


def _has(kind: ParameterKind, name: str, twin: TwinModel) -> bool:
    """Whether there is anything to move: a joint without a tendon or without limits has no such parameter."""
    place = twin.place(name)
    if kind.element == "tendon":
        return place.tendon is not None
    if kind.key in ("range_lower", "range_upper") and place.joint is not None:
        return bool(twin.base_model.jnt_limited[twin.base_model.joint(place.joint).id])
    return True


def _moved_bodies(twin: TwinModel, moving: tuple[str, ...]) -> list[str]:
    joints = [twin.hand.description.joints[name].joint for name in moving]
    bodies = [twin.model.body(int(twin.model.joint(j).bodyid[0])) for j in joints]
    return list(dict.fromkeys(body.name for body in bodies if body.mass[0] > 0))


def _variable(
    entry: SpaceEntry, kind: ParameterKind, twin: TwinModel, label: str, members: list[str], space: str
) -> Variable:
    first = twin.parameter(members[0])
    current, (least, most) = float(first.read(twin.base_model)), first.limits
    start = current if entry.start is None else entry.start
    lower = least if entry.lower is None else entry.lower
    upper = most if entry.upper is None else entry.upper
    boxed = entry.within is not None or entry.reach is not None
    if boxed:
        reach = entry.reach if entry.within is None else entry.within * abs(start)
        if not reach:
            raise BadInput(f"space '{space}': {label} starts at 0, and a fraction of that is nothing", todo="Use reach")
        lower, upper = start - reach, start + reach
        # a box around a positive parameter may not reach below zero: such friction does not exist
        lower, upper = max(lower, least), min(upper, most)
    if not least <= lower < upper <= most:
        raise BadInput(
            f"space '{space}': bounds {lower:g} to {upper:g} {kind.unit} of {label} are not physical",
            allowed=f"{least:g} to {most:g} {kind.unit}",
        )
    if start <= lower and kind.log and entry.start is None:
        start = min(lower * ZERO_START_FACTOR, upper)
    joints = tuple(j for name in members for j in _touched(twin, kind, name.rpartition(".")[0]))
    return ParameterVariable(
        name=label,
        unit=kind.unit,
        lower=lower,
        upper=upper,
        start=float(min(max(start, lower), upper)),
        log=kind.log and lower > 0 and not boxed,
        parameters=tuple(members),
        joints=joints,
    )


def _touched(twin: TwinModel, kind: ParameterKind, target: str) -> list[str]:
    if kind.element == "body":
        body = twin.model.body(target).id
        return [j for j, dof in zip(twin.joints, twin.dof_adr, strict=True) if twin.model.dof_bodyid[dof] == body]
    place = twin.place(target)
    names = {info.joint: name for name, info in twin.hand.description.joints.items()}
    driven = place.driven if kind.element != "joint" else (place.joint,)
    return [names[joint] for joint in driven if joint in names]
