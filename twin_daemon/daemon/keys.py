"""The keys of a configuration, walked by their types: what may stand where, in a file and in the environment."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, SecretStr
from pydantic.fields import FieldInfo

ENTRY = "NAME"
"""Stands for the free name in a table of sections, as in gate.limits.NAME.velocity_rad_s."""


@dataclass(frozen=True)
class Key:
    """One key with a value of its own: where it stands, and its field."""

    path: tuple[str, ...]
    field: FieldInfo

    @property
    def dotted(self) -> str:
        return ".".join(self.path)

    @property
    def variable(self) -> str:
        """The environment variable that overrides it."""
        return "TWIN_" + "__".join(part if part == ENTRY else part.upper() for part in self.path)

    @property
    def live(self) -> bool:
        """Whether a running daemon takes a change over."""
        extra = self.field.json_schema_extra
        return isinstance(extra, dict) and extra.get("live") is True

    @property
    def secret(self) -> bool:
        return SecretStr in kinds(self.field.annotation)


def keys_of(model: type[BaseModel], above: tuple[str, ...] = ()) -> Iterator[Key]:
    """Every key of a model, those of its sections and of its tables of sections among them."""
    for name, field in model.model_fields.items():
        path = (*above, name)
        section, table = section_of(field.annotation), table_of(field.annotation)
        if section is not None:
            yield from keys_of(section, path)
        elif table is not None and section_of(table) is not None:
            yield from keys_of(section_of(table) or model, (*path, ENTRY))
        else:
            yield Key(path, field)


def kinds(annotation: Any) -> tuple[Any, ...]:
    """The alternatives of a type: (float, NoneType) of `float | None`."""
    return get_args(annotation) if get_origin(annotation) in (Union, types.UnionType) else (annotation,)


def section_of(annotation: Any) -> type[BaseModel] | None:
    """The model of a field that is a section, optional or not."""
    return next((kind for kind in kinds(annotation) if isinstance(kind, type) and issubclass(kind, BaseModel)), None)


def table_of(annotation: Any) -> Any | None:
    """The type of the values of a field that is a table by free names."""
    return next((get_args(kind)[1] for kind in kinds(annotation) if get_origin(kind) is dict), None)


def takes_text(annotation: Any) -> bool:
    """Whether a text is meant as it stands, rather than as a number, a truth value or a list."""
    return any(
        kind is SecretStr
        or (isinstance(kind, type) and not issubclass(kind, bool | int | float | BaseModel | types.NoneType))
        or get_origin(kind) is Literal
        for kind in kinds(annotation)
        if get_origin(kind) is not dict
    )
