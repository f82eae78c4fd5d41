"""One fitted value with what is known of it: the type that fits, verdicts and pages share."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict

Identifiability = Literal["identifiable", "weak", "not_identifiable"]

Number = Annotated[float, BeforeValidator(lambda value: float("nan") if value is None else value)]
"""A number that may be unknown: NaN in memory, null in JSON."""

Correlated = tuple[tuple[str, ...], np.ndarray]
"""Names (p,) of values that were fitted together, and their correlations (p, p)."""


def with_unit(number: str, unit: str) -> str:
    """A number as text with its unit, for people: what has none is a bare number."""
    return number if unit == "1" else f"{number} {unit}"


class Estimate(BaseModel):
    """One value in `unit` with its 95 % interval and the bounds that it was looked for within."""

    model_config = ConfigDict(frozen=True)

    value: Number
    """The value, in `unit`."""
    unit: str
    """Its unit."""
    ci95: tuple[Number, Number]
    """The 95 % interval."""
    lower: float | None = None
    """The lower bound of the fit."""
    upper: float | None = None
    """The upper bound of the fit."""
    at_bound: bool = False
    """Whether it ended on a bound."""
    identifiable: Identifiability | None = None
    """How well the data determine it."""
    confused_with: str | None = None
    """The variable that it trades off with."""
