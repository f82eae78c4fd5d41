"""YAML files of people: read them, and say in one line what is wrong and where."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from twin_daemon.errors import BadInput

M = TypeVar("M", bound=BaseModel)

MAX_BYTES = 4_000_000
"""A description or a trajectory file is small; a larger file is something else (or an attack on the parser)."""


class _UniqueKeys(yaml.SafeLoader):
    """YAML keeps the last of two equal keys silently; here they are an error. Aliases stay allowed."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen: set[Any] = set()
        for key_node, _ in node.value:
            if key_node.tag == "tag:yaml.org,2002:merge":
                continue
            key = self.construct_object(key_node, deep=True)
            if isinstance(key, str | int | float) and key in seen:
                problem = f"key '{key}' stands there twice"
                raise yaml.constructor.ConstructorError(None, None, problem, key_node.start_mark)
            if isinstance(key, str | int | float):
                seen.add(key)
        return super().construct_mapping(node, deep)


def read_yaml(path: Path, what: str) -> dict[str, Any]:
    """The mapping in `path`. BadInput where it is missing, too large, no YAML, or no mapping; `what` names its kind."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise BadInput(f"{size} bytes are too many for {what}", where=path, allowed=f"up to {MAX_BYTES} bytes")
        content = yaml.load(path.read_text(encoding="utf-8"), Loader=_UniqueKeys)
    except OSError as error:
        raise BadInput(f"cannot read {what}: {error.strerror or error}", where=path) from error
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise BadInput(f"no valid YAML: {error}", where=path, todo=f"Correct {what}") from error
    if not isinstance(content, dict):
        raise BadInput(f"{what} is a mapping of keys, this is a {type(content).__name__}", where=path)
    return content


def validated(kind: type[M], raw: Mapping[str, Any], path: Path | str) -> M:
    """`raw` as a `kind`. BadInput with the first error: its key path, what is wrong, the nearest known key."""
    try:
        return kind.model_validate(dict(raw))
    except ValidationError as error:
        raise BadInput(_first_error(kind, error), where=path, todo="Correct the file") from error


def _first_error(kind: type[BaseModel], error: ValidationError) -> str:
    details = error.errors()
    first = details[0]
    key = ".".join(str(part) for part in first["loc"])
    text = first["msg"].removeprefix("Value error, ")
    if first["type"] == "extra_forbidden":
        known = _fields_at(kind, first["loc"])
        close = difflib.get_close_matches(str(first["loc"][-1]), known, n=1)
        text = f"unknown key. Did you mean '{close[0]}'?" if close else f"unknown key. Known: {', '.join(known)}"
    elif first["type"] not in ("value_error", "missing"):
        text += f", not {_short(first['input'])}"
    more = f" ({len(details) - 1} more errors)" if len(details) > 1 else ""
    return f"{key}: {text}{more}" if key else f"{text}{more}"


def _short(value: Any) -> str:
    """`value` for a message; of collections only the type, since YAML aliases can make their text endless."""
    if not isinstance(value, str | int | float | bool | None):
        return f"a {type(value).__name__}"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _fields_at(kind: type[BaseModel], location: tuple[int | str, ...]) -> list[str]:
    """Keys that are known where `location` ends: walks down the models, through dicts and lists of models."""
    current: type[BaseModel] | None = kind
    for part in location[:-1]:
        if current is None or part not in _named_fields(current):
            continue  # the key of a dict or the index of a list: the model below it stays the same
        current = _model_in(_named_fields(current)[str(part)])
    return list(_named_fields(current)) if current else []


def _named_fields(kind: type[BaseModel]) -> dict[str, Any]:
    return {field.alias or name: field.annotation for name, field in kind.model_fields.items()}


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """The model inside an annotation such as dict[str, JointInfo]."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in getattr(annotation, "__args__", ()):
        found = _model_in(inner)
        if found:
            return found
    return None
