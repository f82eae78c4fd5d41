"""What the daemon is told: defaults, then the YAML file, then the environment; and where each value came from."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, SecretStr, ValidationError

from twin_daemon.daemon.keys import keys_of, section_of, table_of, takes_text
from twin_daemon.daemon.settings import TwinConfig
from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand.validation import first_error, read_yaml
from twin_daemon.yaml_files import load_yaml

PREFIX, BETWEEN = "TWIN_", "__"
DEFAULT, FILE = "default", "file"
OTHER_VARIABLES = {
    "TWIN_STATE_DIR": "folder of versions, recordings and the audit log; the platform's state folder without it",
    "TWIN_KEYS": "file of the identities and their secret keys; `keys.json` in the state folder without it",
    "TWIN_AUTHORITY": "folder of the authority's certificate and key, such as a stick that is put away again",
    "TWIN_SECURITY": "folder of one identity's certificate, where it is not one of the state folder's",
    "TWIN_AS": "in whose name a command talks to the daemon, one of the identities",
    "TWIN_EFFECTS": "folder of effects of your own, one file each; only you or root may write to it",
    "TWIN_THREADS": "most cores that a fit or a diagnosis uses",
    "TWIN_DEBUG": "1: a bug shows its traceback instead of one line",
}
"""Variables of this program that are no keys of the configuration."""


@dataclass(frozen=True)
class Effective:
    """A configuration, and for each dotted key that is not a default where its value came from."""

    config: TwinConfig
    sources: dict[str, str] = field(default_factory=dict)

    def source(self, dotted: str) -> str:
        """`default`, `file` or the name of the variable."""
        parts = dotted.split(".")
        heads = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
        return next((self.sources[head] for head in heads if head in self.sources), DEFAULT)


def load_config(path: Path | None, environment: Mapping[str, str]) -> Effective:
    """The configuration of a file (None: without one) and the environment, which wins.

    Raises BadInput that names the key or the variable, what is allowed there, and the nearest known one.
    """
    raw: dict[str, Any] = {}
    if path is not None and _says_something(path):
        raw = _relative_to(path.parent, read_yaml(path, "a configuration"))
    sources = {".".join(key): FILE for key in _leaves(raw)}
    for name, key, value in _overrides(environment):
        _put(raw, key, value, name)
        dotted = ".".join(key)
        sources = {known: source for known, source in sources.items() if not known.startswith(f"{dotted}.")}
        sources[dotted] = name
    try:
        return Effective(TwinConfig.model_validate(raw), sources)
    except ValidationError as error:
        location = ".".join(str(part) for part in error.errors()[0]["loc"])
        source = Effective(TwinConfig(), sources).source(location)
        where = path if source in (FILE, DEFAULT) and path is not None else f"environment, {source}"
        raise BadInput(first_error(TwinConfig, error), where=where, todo="Correct this key") from None


def shown(effective: Effective) -> list[tuple[str, Any, str]]:
    """Each key that has a value, its value and where that came from. A secret is never among the values."""
    return [(key, value, effective.source(key)) for key, value in _values(effective.config)]


def after_reload(running: TwinConfig, new: TwinConfig) -> tuple[TwinConfig, list[str], list[str]]:
    """`running` with the changes that can be taken live; the keys of these, and those that need a restart."""
    before, wanted = dict(_values(running)), dict(_values(new))
    changed = [key for key in {**before, **wanted} if before.get(key) != wanted.get(key)]
    live = {key.path for key in keys_of(TwinConfig) if key.live}
    taken = [key for key in changed if tuple(key.split(".")) in live]
    update = {name: wanted[f"daemon.{name}"] for name in (key.removeprefix("daemon.") for key in taken)}
    merged = running.model_copy(update={"daemon": running.daemon.model_copy(update=update)})
    return merged, taken, [key for key in changed if key not in taken]


def _says_something(path: Path) -> bool:
    """An empty file, or one of comments alone, is a configuration of defaults."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        return True  # whoever reads it next says what is wrong
    return any(line.strip() and not line.lstrip().startswith("#") for line in text.splitlines())


def _relative_to(folder: Path, raw: dict[str, Any]) -> dict[str, Any]:
    """Paths in the file are relative to the file, not to wherever the daemon was started."""
    raw = dict(raw)
    model, hand = raw.get("model"), raw.get("hand")
    if isinstance(model, str):
        raw["model"] = str(folder / model)
    if isinstance(hand, str) and hand.endswith((".yaml", ".yml")):
        raw["hand"] = str(folder / hand)
    return raw


def _leaves(raw: Any, above: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    if isinstance(raw, Mapping) and raw:
        for key, value in raw.items():
            yield from _leaves(value, (*above, str(key)))
    elif above:
        yield above


def _values(model: BaseModel, above: str = "") -> Iterator[tuple[str, Any]]:
    for name in type(model).model_fields:
        yield from _flat(f"{above}{name}", getattr(model, name))


def _flat(dotted: str, value: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(value, BaseModel):
        yield from _values(value, f"{dotted}.")
    elif isinstance(value, dict) and value:
        for name, entry in value.items():
            yield from _flat(f"{dotted}.{name}", entry)
    elif isinstance(value, SecretStr):
        yield dotted, "(set, not shown)"
    else:
        yield dotted, str(value) if isinstance(value, Path) else value


def _overrides(environment: Mapping[str, str]) -> Iterator[tuple[str, tuple[str, ...], Any]]:
    """Variable, key and value of everything that the environment sets."""
    for name in sorted(environment):
        if not name.startswith(PREFIX) or name in OTHER_VARIABLES or not environment[name]:
            continue
        found = _resolve(name)
        if found is None:
            continue
        key, annotation = found
        text = environment[name]
        if takes_text(annotation) and text != "null":
            yield name, key, text
            continue
        try:
            yield name, key, load_yaml(text)
        except yaml.YAMLError as error:
            raise BadInput(f"no value: {error}", where=f"environment, {name}", todo="Correct it") from None


def _resolve(name: str) -> tuple[tuple[str, ...], Any] | None:
    """The key that a variable means, and its type. None for a variable of another program; BadInput for a typing
    mistake."""
    key: list[str] = []
    annotation: Any = TwinConfig
    for part in name.removeprefix(PREFIX).split(BETWEEN):
        section, table = section_of(annotation), table_of(annotation)
        if section is not None and part.lower() in section.model_fields:
            key.append(part.lower())
            annotation = section.model_fields[part.lower()].annotation
        elif section is None and table is not None and part:
            key.append(part)  # the names of joints and commands are written as they are
            annotation = table
        else:
            known = [*(one.variable for one in keys_of(TwinConfig)), *_sections(), *OTHER_VARIABLES]
            if BETWEEN not in name and not difflib.get_close_matches(name, known, n=1, cutoff=0.85):
                return None
            raise BadInput("there is no such setting", where=f"environment, {name}", todo=nearest(name, known))
    return tuple(key), annotation


def _sections() -> list[str]:
    return [PREFIX + name.upper() for name, one in TwinConfig.model_fields.items() if section_of(one.annotation)]


def _put(raw: dict[str, Any], key: tuple[str, ...], value: Any, name: str) -> None:
    for part in key[:-1]:
        below = raw.get(part)
        if below is not None and not isinstance(below, dict):
            raise BadInput(f"'{part}' is no section in the file", where=f"environment, {name}", todo="Correct the file")
        raw[part] = {} if below is None else dict(below)
        raw = raw[part]
    raw[key[-1]] = value
