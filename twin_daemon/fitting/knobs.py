"""What a fit may turn: parameters of the model, values of effects, and the onset of a recording."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np


@dataclass(frozen=True)
class Prior:
    """A Gaussian belief about a knob, in its search coordinate (the logarithm where the knob is logarithmic)."""

    mean: float
    sigma: float


@dataclass(frozen=True)
class Knob:
    """One dimension of a search.

    `writes` says what it turns: ("parameter", name), ("effect", "key:target", parameter) or ("onset", index).
    Several writes move together. `mode` "scale" multiplies what each target has instead of setting it.
    `noise_floor` is the smallest step that means anything, for finite differences.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    log: bool
    writes: tuple[tuple[str, ...], ...]
    mode: Literal["set", "scale"] = "set"
    prior: Prior | None = None
    step: float = 1e-3
    bounds_are: Literal["physical", "search"] = "search"
    joints: tuple[str, ...] = field(default=())

    @property
    def low(self) -> float:
        return float(np.log(self.lower)) if self.log else self.lower

    @property
    def high(self) -> float:
        return float(np.log(self.upper)) if self.log else self.upper

    def coordinate(self, value: float) -> float:
        """Value -> search coordinate in 0..1 over the bounds."""
        position = float(np.log(max(value, self.lower))) if self.log else value
        return float(np.clip((position - self.low) / (self.high - self.low), 0.0, 1.0))

    def value(self, coordinate: float) -> float:
        """Search coordinate in 0..1 -> value."""
        position = self.low + float(coordinate) * (self.high - self.low)
        return float(np.clip(np.exp(position) if self.log else position, self.lower, self.upper))

    def at_bound(self, value: float) -> bool:
        """Whether the search stopped here because it was not allowed further."""
        coordinate = self.coordinate(value)
        return coordinate < 5e-3 or coordinate > 1.0 - 5e-3


_FACTOR = 2.0
_SIGNED_SHARE = 0.05  # of the box


def anchored(knob: Knob) -> Knob:
    """The knob with a wide belief about where it starts: within a factor of two, or a twentieth of its box."""
    if knob.log:
        return replace(knob, prior=Prior(float(np.log(knob.start)), float(np.log(_FACTOR))))
    width = max(abs(knob.start), _SIGNED_SHARE * (knob.upper - knob.lower))
    return replace(knob, prior=Prior(knob.start, width))
