"""One effect with one set of values for several groups of joints: where it may be, and which values it may have."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from twin_daemon.diagnosis.fit import weighed_share
from twin_daemon.effects import LIBRARY
from twin_daemon.effects.base import Effect, Parameter
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.estimation.thresholds import Z95
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.submodel import linked
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

V = TypeVar("V")


class Cause(ABC):
    """What may be behind errors at several groups, with one set of values for all of them."""

    @property
    @abstractmethod
    def name(self) -> str: ...

    @property
    @abstractmethod
    def amplitudes(self) -> tuple[str, ...]:
        """The parameters that are moved."""

    @property
    @abstractmethod
    def is_load(self) -> bool:
        """Whether it is a torque on what groups carry, which ties them together."""

    @property
    @abstractmethod
    def parts(self) -> tuple[SharedCause, ...]:
        """The effects that it is made of."""

    @abstractmethod
    def values_of(self, part: SharedCause, values: Mapping[str, V]) -> dict[str, V]:
        """The values of one of its effects."""

    @abstractmethod
    def accepted(self, values: Mapping[str, float]) -> dict[str, float]:
        """The values, complete and within what is accepted at all."""

    @abstractmethod
    def neutral(self) -> dict[str, float]:
        """The values with which it does nothing."""

    @abstractmethod
    def parameter(self, name: str) -> Parameter: ...

    def in_detail(self) -> SharedCause | None:
        """The same cause with what refines its effect moved, too; None where nothing does or it is already."""
        return None

    def terms(self, twin: TwinModel, values: Mapping[str, float]) -> Terms:
        """The twin's terms with this cause."""
        terms = twin.terms
        for part in self.parts:
            terms = terms.with_effect(part.term(self.values_of(part, values)))
        return terms

    def typical(self, name: str) -> float:
        """A step of a parameter that is certainly felt, in its unit."""
        parameter = self.parameter(name)
        if parameter.refines:
            return parameter.upper
        return 1.0 if parameter.neutral == 1.0 else parameter.default - parameter.neutral

    def estimates(
        self, twin: TwinModel, values: Mapping[str, float], slopes: np.ndarray, inflated: float
    ) -> dict[str, Estimate]:
        """The values by parameter with their intervals, from the slopes (m, q) of the rows by the amplitudes.

        The variance of the rows is so many times `inflated`.
        """
        limits = {name: self.parameter(name).limits for name in self.amplitudes}
        # what the data say nothing of is anywhere within what is accepted at all
        known = np.diag([(1.0 / (upper - lower)) ** 2 for lower, upper in limits.values()])
        sigmas = np.sqrt(np.diag(np.linalg.inv(slopes.T @ slopes / inflated + known)))
        found = {}
        for (name, (lower, upper)), sigma in zip(limits.items(), sigmas, strict=True):
            unit = self.parameter(name).unit
            half = Z95 * float(np.hypot(sigma, weighed_share(twin, unit) * values[name]))
            interval = (max(values[name] - half, lower), min(values[name] + half, upper))
            found[name] = Estimate(value=values[name], unit=unit, ci95=interval)
        return found


@dataclass(frozen=True)
class SharedCause(Cause):
    """An effect with one set of values for several groups, at all servos, at a link that they carry, or at the base.

    Values that are `given` stay as they are; what refines the effect does so too, unless it is `refined`.
    """

    effect: Effect
    target: str
    given: Mapping[str, float] = field(default_factory=dict)
    refined: bool = False

    @property
    def name(self) -> str:
        return f"{self.effect.key}:{self.target}"

    @property
    def is_load(self) -> bool:
        return self.effect.shared == "load"

    @property
    def parts(self) -> tuple[SharedCause, ...]:
        return (self,)

    def values_of(self, part: SharedCause, values: Mapping[str, V]) -> dict[str, V]:
        return dict(values)

    @property
    def amplitudes(self) -> tuple[str, ...]:
        if self.is_load:
            names = tuple(p.name for p in self.effect.parameters if self.refined or not p.refines)
        else:
            names = (self.effect.everywhere,) if self.effect.everywhere else self.effect.presence
        return tuple(name for name in names if name not in self.given)

    @property
    def refining(self) -> tuple[str, ...]:
        """The amplitudes that refine the effect."""
        return tuple(name for name in self.amplitudes if self.parameter(name).refines)

    def in_detail(self) -> SharedCause | None:
        other = replace(self, refined=True)
        return other if other.amplitudes != self.amplitudes else None

    def possible(self, twin: TwinModel, values: Mapping[str, float]) -> bool:
        """Whether what refines the effect is within where it is looked for at its place."""
        bounds = self.effect.bounds(twin.scale(self.target)) if self.refining else {}
        return all(bounds[name][0] <= values[name] <= bounds[name][1] for name in self.refining)

    def term(self, values: Mapping[str, float]) -> EffectTerm:
        return EffectTerm(effect=self.effect.key, target=self.target, values=self.accepted(values))

    def accepted(self, values: Mapping[str, float]) -> dict[str, float]:
        return self.effect.complete(self.effect.clipped({**values, **self.given}))

    def neutral(self) -> dict[str, float]:
        return self.effect.neutral()

    def starts(self, twin: TwinModel, joints: Sequence[str]) -> tuple[dict[str, float], ...]:
        place = self.target if self.target in twin.joints else joints[0]
        starts = self.effect.starts_everywhere() or self.effect.starts(twin.scale(place))
        return tuple(self.accepted(s) for s in starts)

    def directions(self, starts: Sequence[dict[str, float]]) -> list[dict[str, float]]:
        """The largest start of each sign of each amplitude."""
        neutral, found = self.effect.neutral(), {}
        for start in starts:
            signs = tuple(np.sign(start[name] - neutral[name]) for name in self.amplitudes)
            size = sum(abs(start[name] - neutral[name]) for name in self.amplitudes)
            if signs not in found or size > found[signs][0]:
                found[signs] = (size, start)
        return [start for _, start in found.values()]

    def along(self, start: Mapping[str, float], amount: float) -> dict[str, float]:
        """The values this far along the line from neutral to a start."""
        neutral = self.effect.neutral()
        held = {parameter.name for parameter in self.effect.parameters if parameter.held}
        moved = {n: neutral[n] + amount * (start[n] - neutral[n]) for n in self.amplitudes if n not in held}
        return self.accepted({**start, **moved})

    def form(self, values: Mapping[str, float]) -> tuple[float, ...]:
        """What no fit moves of these values."""
        return tuple(value for name, value in self.accepted(values).items() if name not in self.amplitudes)

    def parameter(self, name: str) -> Parameter:
        return next(parameter for parameter in self.effect.parameters if parameter.name == name)


def shared_causes(twin: TwinModel, groups: Sequence[Sequence[str]], *, everywhere: bool) -> list[SharedCause]:
    """What may be behind errors at several groups of joints; at all servos or joints where it may be `everywhere`.

    A load is looked for where all groups feel it: what one of them does not feel explains nothing of its error.
    """
    felt = [joint for joint in twin.joints if all(len(linked(twin, [group, [joint]])) == 1 for group in groups)]
    places = {
        "servos": [ROBOT] if everywhere else [],
        "joints": [ROBOT] if everywhere else [],
        "load": [HAND, *felt],
    }
    return [
        SharedCause(effect, target)
        for effect in tuple(LIBRARY.values())
        if effect.shared
        for target in (place.target for place in effect.distinct(map(twin.place, places[effect.shared])))
    ]
