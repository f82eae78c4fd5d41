"""YAML files of people: read them, and say in one line what is wrong and where."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.yaml_files import MAX_BYTES, load_yaml

M = TypeVar("M", bound=BaseModel)


def read_yaml(path: Path, what: str) -> dict[str, Any]:
    """The mapping in `path`. BadInput where it is missing, too large, no YAML, or no mapping; `what` names its kind."""
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise BadInput(f"{size} bytes are too many for {what}", where=path, allowed=f"up to {MAX_BYTES} bytes")
        content = load_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"cannot read {what}: {error.strerror or error}", where=path) from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise BadInput(f"no valid YAML: {error}", where=path, todo=f"Correct {what}") from error
    if not isinstance(content, dict):
        raise BadInput(f"{what} is a mapping of keys, this is a {type(content).__name__}", where=path)
    return content


def validated(kind: type[M], raw: Mapping[str, Any], path: Path | str) -> M:
    """`raw` as a `kind`. BadInput with the first error: its key path, what is wrong, the nearest known key."""
    try:
        return kind.model_validate(dict(raw))
    except ValidationError as error:
        raise BadInput(first_error(kind, error), where=path, todo="Correct the file") from error


def first_error(kind: type[BaseModel], error: ValidationError) -> str:
    """The first of the errors in words: its key, what is wrong, the nearest known key."""
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
