"""Results as JSON: undefined numbers are null, keys are sorted where bytes must not depend on how they came about."""

from __future__ import annotations

import dataclasses
import enum
import json
import math
from collections.abc import Mapping, Set
from datetime import date
from pathlib import PurePath
from typing import Any


def plain(value: Any) -> Any:
    """Anything a command may report, as what JSON knows. Numbers that are not finite become None."""
    if value is None or isinstance(value, (bool, str)):
        return str(value) if isinstance(value, str) else value
    if isinstance(value, enum.Enum):
        return plain(value.value)
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(plain(key)): plain(item) for key, item in value.items()}
    if isinstance(value, Set):
        return [plain(item) for item in sorted(value, key=str)]
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, date):
        return value.isoformat()
    if isinstance(value, type):
        raise TypeError(f"{value.__name__} is a class, not a result")
    if dataclasses.is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if hasattr(value, "model_dump"):  # pydantic
        return plain(value.model_dump(by_alias=True))
    if hasattr(value, "tolist"):  # numpy scalars and arrays
        return plain(value.tolist())
    raise TypeError(f"{type(value).__name__} has no JSON form")


def canonical(value: Any) -> bytes:
    """The one spelling of a JSON value, for hashing: the same content gives the same bytes.

    Keys are sorted, nothing is padded, and a number is spelled alike whether it came as 1, 1.0 or a numpy scalar.
    """
    spelled = json.dumps(_one_spelling(plain(value)), sort_keys=True, separators=(",", ":"), allow_nan=False)
    return spelled.encode("ascii")


def _one_spelling(value: Any) -> Any:
    if isinstance(value, float) and value.is_integer() and abs(value) < 2**53:
        return int(value)
    if isinstance(value, dict):
        return {key: _one_spelling(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_one_spelling(item) for item in value]
    return value
