"""`docs/configuration.md`, made of the types that check a configuration: it cannot say anything else than they do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import annotated_types
from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from twin_daemon.daemon.configuration import OTHER_VARIABLES
from twin_daemon.daemon.keys import ENTRY, Key, keys_of, kinds, section_of
from twin_daemon.daemon.settings import TwinConfig

_HEAD = """\
# Configuration

This page is made by `twin config docs -o docs/configuration.md`, from the types that check the configuration.

One YAML file: `twin run -c twin.yaml`. Every key may be left out. What the command line says wins over the environment,
which wins over the file. `twin config check FILE` says whether the daemon would take it, `twin config show FILE` what
it comes to and where each value came from. A key that does not exist is refused with the nearest one that does.

Each key has an environment variable: `TWIN_`, then its section and name in capitals with two underscores between.
Values are written as in YAML: `TWIN_DAEMON__HORIZON_S=1.0`, `TWIN_GATE__EFFORT_LIMIT='{rh_FFJ3: 2.0}'`. Names of joints
and commands keep their letters: `TWIN_GATE__LIMITS__rh_WRJ2__VELOCITY_RAD_S=1.0`. A path there is relative to the
working folder; in the file it is relative to the file. An empty variable counts as none. `TWIN_ENDPOINT` is heard by
every command, the others by `twin run` and `twin config`.

**Live**: `systemctl reload twin-daemon` (SIGHUP to a `twin run -c FILE` without a terminal) reads the configuration
again. Keys marked "live" are taken over at once; of the others the log says that they need a restart. A configuration
that is wrong is refused, and the one before stays.
"""
_OTHERS = """
## Other variables

| variable | meaning |
|---|---|
"""


def page() -> str:
    """The page as Markdown."""
    parts = [_HEAD]
    sections: dict[tuple[str, ...], list[Key]] = {}
    for key in keys_of(TwinConfig):
        sections.setdefault(key.path[:-1], []).append(key)
    for above, keys in sections.items():
        parts.append(_section(above, keys))
    rows = "".join(f"| `{name}` | {meaning} |\n" for name, meaning in OTHER_VARIABLES.items())
    return "".join(parts) + _OTHERS + rows


def _section(above: tuple[str, ...], keys: list[Key]) -> str:
    title = f"`{'.'.join(above)}`" if above else "At the top"
    text = f"\n## {title}\n\n{_said_of(above)}\n\n" if above else f"\n## {title}\n\n"
    text += "| key | meaning | allowed | default | change |\n|---|---|---|---|---|\n"
    for key in keys:
        change = "live" if key.live else "restart"
        meaning = key.field.description or ""
        text += f"| `{key.path[-1]}` | {meaning} | {_allowed(key)} | {_default(key)} | {change} |\n"
    return text


def _said_of(above: tuple[str, ...]) -> str:
    model: type[BaseModel] = TwinConfig
    for part in above:
        field = model.model_fields.get(part)
        if field is not None:
            model = section_of(field.annotation) or _entries(field.annotation) or model
    said = " ".join((model.__doc__ or "").split())
    return f"{said} {ENTRY} is the command's." if ENTRY in above else said


def _entries(annotation: Any) -> type[BaseModel] | None:
    return next((section_of(get_args(kind)[1]) for kind in kinds(annotation) if get_origin(kind) is dict), None)


def _allowed(key: Key) -> str:
    words = [word for kind in kinds(key.field.annotation) if (word := _word(kind))]
    bounds = [_bound(one) for one in key.field.metadata]
    return ", ".join([" or ".join(dict.fromkeys(words)), *filter(None, bounds)])


def _word(kind: Any) -> str:
    if get_origin(kind) is Literal:
        return " or ".join(f"`{value}`" for value in get_args(kind))
    if get_origin(kind) is dict:
        return f"table of {_word(get_args(kind)[1])}s by name"
    return {float: "number", int: "whole number", bool: "`true` or `false`", str: "text", Path: "path"}.get(kind, "")


def _bound(one: Any) -> str:
    for name, sign in (("gt", ">"), ("ge", "≥"), ("lt", "<"), ("le", "≤")):
        if isinstance(one, getattr(annotated_types, name.capitalize())):
            return f"{sign} {getattr(one, name):g}"
    pattern = getattr(one, "pattern", None)
    return "letters, digits, `_` and `-`, with `/` between parts" if pattern else ""


def _default(key: Key) -> str:
    if key.field.is_required():
        return "must be given"
    value = key.field.get_default(call_default_factory=True)
    if value is None or value is PydanticUndefined:
        return "none"
    return f"`{value:.4g}`" if isinstance(value, float) else f"`{json.dumps(value)}`"
