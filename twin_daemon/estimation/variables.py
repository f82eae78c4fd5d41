"""What a fit may move: parameters of the model, values of effects, and the time offset of a recording's commands.

A variable has bounds, a start and, where it is uncertain rather than unknown, a prior. Its unit coordinate is its place
between the bounds, 0 to 1, on a logarithmic scale where it has one.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Self, TypeAlias

import numpy as np

from twin_daemon.effects.base import Parameter
from twin_daemon.estimation.thresholds import (
    ANCHOR_FACTOR,
    ANCHOR_SIGNED_SHARE,
    AT_BOUND_SHARE,
    CHANGED_BEFOREHAND,
)
from twin_daemon.simulation.alignment import Aligned


@dataclass(frozen=True)
class Prior:
    """A Gaussian belief about a variable, on its own scale (of the logarithm where the variable is logarithmic).

    With `changed` it is remembered: near the mean, or, as it may have changed since, somewhere within that sigma.
    """

    mean: float
    sigma: float
    changed: float | None = None

    def missed(self, position: np.ndarray) -> np.ndarray:
        """(b,) at positions (b,): in sigma, with the sign of the side; its square is -2 log of the density's ratio."""
        z = (position - self.mean) / self.sigma
        if self.changed is None:
            return z
        same = np.log1p(-CHANGED_BEFOREHAND) - np.log(self.sigma)
        other = np.log(CHANGED_BEFOREHAND) - np.log(self.changed)
        near = np.logaddexp(same - 0.5 * z**2, other - 0.5 * ((position - self.mean) / self.changed) ** 2)
        return np.sign(z) * np.sqrt(np.maximum(2.0 * (np.logaddexp(same, other) - near), 0.0))


@dataclass(frozen=True)
class Remembered:
    """A value as an earlier fit has left it, and how far it may be off by now without wear (one sigma), in its unit."""

    value: float
    sigma: float


@dataclass
class Settings:
    """What a point sets: parameters by name, effects' values by (key, target), the onset (s) of each recording.

    `nominal` are the values that factors multiply; `effects_moved` says whether any variable sets an effect's value.
    """

    nominal: Mapping[str, float]
    parameters: dict[str, float]
    effects: dict[tuple[str, str], dict[str, float]]
    onsets_s: list[float]
    effects_moved: bool = False

    def multiply(self, parameter: str, factor: float) -> None:
        """Factors on one parameter multiply."""
        self.parameters[parameter] = float(factor * self.parameters.get(parameter, self.nominal[parameter]))


@dataclass(frozen=True)
class _Bounded:
    """What all variables have in common: a name, and a scale between two bounds in `unit`.

    `joints` are those that the variable acts on; none where it acts on all.
    """

    name: str
    unit: str
    lower: float
    upper: float
    start: float
    log: bool = False
    prior: Prior | None = field(default=None, kw_only=True)
    joints: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def low(self) -> float:
        return float(np.log(self.lower)) if self.log else self.lower

    @property
    def high(self) -> float:
        return float(np.log(self.upper)) if self.log else self.upper

    def coordinate(self, value: float) -> float:
        """Value -> unit coordinate."""
        position = float(np.log(max(value, self.lower))) if self.log else value
        return float(np.clip((position - self.low) / (self.high - self.low), 0.0, 1.0))

    def value(self, coordinate: float) -> float:
        """Unit coordinate -> value."""
        position = self.low + float(coordinate) * (self.high - self.low)
        return float(np.clip(np.exp(position) if self.log else position, self.lower, self.upper))

    def at_bound(self, value: float) -> bool:
        """Whether a search stopped here because it was not allowed further."""
        coordinate = self.coordinate(value)
        return coordinate < AT_BOUND_SHARE or coordinate > 1.0 - AT_BOUND_SHARE

    @property
    def parameters_moved(self) -> tuple[str, ...]:
        """The model's parameters that it sets or multiplies."""
        return ()

    @property
    def factors(self) -> tuple[str, ...]:
        """The model's parameters that it multiplies."""
        return ()

    def without(self, parameters: Collection[str]) -> Self:
        """The same variable that leaves some of the model's parameters alone."""
        return self


@dataclass(frozen=True)
class ParameterVariable(_Bounded):
    """Parameters of the model, named `<joint, command or body>.<kind>`, all set to one value.

    With `factor` it multiplies each instead; the first is then what its prior is about, and the others go along.
    """

    parameters: tuple[str, ...] = ()
    factor: bool = field(default=False, kw_only=True)

    @property
    def parameters_moved(self) -> tuple[str, ...]:
        return self.parameters

    @property
    def factors(self) -> tuple[str, ...]:
        return self.parameters if self.factor else ()

    def without(self, parameters: Collection[str]) -> Self:
        return replace(self, parameters=tuple(name for name in self.parameters if name not in parameters))

    def write(self, value: float, into: Settings) -> None:
        for name in self.parameters:
            if self.factor:
                into.multiply(name, value)
            else:
                into.parameters[name] = float(value)


@dataclass(frozen=True)
class EffectVariable(_Bounded):
    """One value of one effect at its target. `along` are parameters of the model that it multiplies as well."""

    effect: str = field(kw_only=True)
    target: str = field(kw_only=True)
    parameter: str = field(kw_only=True)
    along: tuple[str, ...] = field(default=(), kw_only=True)

    @property
    def parameters_moved(self) -> tuple[str, ...]:
        return self.along

    @property
    def factors(self) -> tuple[str, ...]:
        return self.along

    def without(self, parameters: Collection[str]) -> Self:
        return replace(self, along=tuple(name for name in self.along if name not in parameters))

    def write(self, value: float, into: Settings) -> None:
        into.effects.setdefault((self.effect, self.target), {})[self.parameter] = float(value)
        into.effects_moved = True
        for name in self.along:
            into.multiply(name, value)


@dataclass(frozen=True)
class OnsetVariable(_Bounded):
    """Seconds by which the commands of some recordings, by their index, come later than the clock says."""

    recordings: tuple[int, ...] = ()

    def over(self, place: Mapping[int, int]) -> OnsetVariable:
        """The same variable where only some recordings are left: their new index by the old one."""
        return replace(self, recordings=tuple(place[index] for index in self.recordings if index in place))

    def write(self, value: float, into: Settings) -> None:
        for index in self.recordings:
            into.onsets_s[index] += float(value)


@dataclass(frozen=True)
class LinkVariable(_Bounded):
    """A combination of link masses by its `number`, in sigma: torques in a roll-out, beside the model."""

    number: int = field(kw_only=True)

    def write(self, value: float, into: Settings) -> None:
        """Nothing: the model keeps its own masses."""


Variable: TypeAlias = ParameterVariable | EffectVariable | OnsetVariable | LinkVariable


def anchored(variable: Variable, remembered: Remembered | None = None) -> Variable:
    """The variable with a wide belief about where it starts: within a factor of two, or a twentieth of its box.

    Where it is `remembered` the belief is as narrow as that, and wide about it should the value have changed.
    """
    if variable.log:
        mean, width = float(np.log(variable.start)), float(np.log(ANCHOR_FACTOR))
    else:
        mean, width = variable.start, max(abs(variable.start), ANCHOR_SIGNED_SHARE * (variable.upper - variable.lower))
    if remembered is None or (variable.log and remembered.value <= 0.0):
        return replace(variable, prior=Prior(mean, width))
    mean = float(np.log(remembered.value)) if variable.log else remembered.value
    sigma = remembered.sigma / remembered.value if variable.log else remembered.sigma
    if not 0.0 < sigma < width:
        return replace(variable, prior=Prior(mean, width))
    return replace(variable, prior=Prior(mean, sigma, changed=width))


def effect_variable(
    key: str, target: str, parameter: Parameter, bounds: tuple[float, float], start: float, joints: tuple[str, ...] = ()
) -> EffectVariable:
    """One value of an effect at its target, within bounds in the parameter's unit."""
    lower, upper = bounds
    return EffectVariable(
        f"{key}:{target}.{parameter.name}",
        parameter.unit,
        lower,
        upper,
        float(min(max(start, lower), upper)),
        parameter.log and lower > 0,
        effect=key,
        target=target,
        parameter=parameter.name,
        joints=joints,
    )


def over_some(
    variables: Sequence[Variable], recordings: Sequence[Aligned], some: Sequence[Aligned]
) -> tuple[Variable, ...]:
    """The same variables, with the recordings whose onsets they move counted over some of all."""
    left = {id(r): index for index, r in enumerate(some)}
    place = {index: left[id(r)] for index, r in enumerate(recordings) if id(r) in left}
    return tuple(v.over(place) if isinstance(v, OnsetVariable) else v for v in variables)
