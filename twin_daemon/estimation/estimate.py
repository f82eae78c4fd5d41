"""One fitted value with what is known of it: the type that fits, verdicts and pages share."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict

Identifiability = Literal["identifiable", "weak", "not_identifiable"]

Number = Annotated[float, BeforeValidator(lambda value: float("nan") if value is None else value)]
"""A number that may be unknown: NaN in memory, null in JSON."""


class Estimate(BaseModel):
    """One value in `unit` with its 95 % interval and the bounds that it was looked for within.

    `confused_with` is the variable that it trades off with, if any.
    """

    model_config = ConfigDict(frozen=True)

    value: Number
    unit: str
    ci95: tuple[Number, Number]
    lower: float | None = None
    upper: float | None = None
    at_bound: bool = False
    identifiable: Identifiability | None = None
    confused_with: str | None = None
