"""Two loads at once, such as one on a link of a robot that stands askew."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

from twin_daemon.diagnosis.shared_cause import Cause, SharedCause
from twin_daemon.effects.base import Parameter

V = TypeVar("V")


@dataclass(frozen=True)
class SharedPair(Cause):
    """Two loads with the values of both, each under its place in the pair and its name (`0.mass`)."""

    both: tuple[SharedCause, SharedCause]

    @property
    def parts(self) -> tuple[SharedCause, ...]:
        return self.both

    @property
    def name(self) -> str:
        return " and ".join(part.name for part in self.both)

    @property
    def amplitudes(self) -> tuple[str, ...]:
        return tuple(f"{index}.{name}" for index, part in enumerate(self.both) for name in part.amplitudes)

    @property
    def is_load(self) -> bool:
        return True

    def joined(self, first: Mapping[str, float], second: Mapping[str, float]) -> dict[str, float]:
        """The pair's values where each of the two has its own."""
        return {f"{index}.{name}": value for index, one in enumerate((first, second)) for name, value in one.items()}

    def along(self, first: Mapping[str, float], start: Mapping[str, float], amount: float) -> dict[str, float]:
        """The values where the first has its own and the second is this far along the line to a start."""
        return self.joined(first, self.both[1].along(start, amount))

    def values_of(self, part: SharedCause, values: Mapping[str, V]) -> dict[str, V]:
        place = f"{self.both.index(part)}."
        return {name.removeprefix(place): value for name, value in values.items() if name.startswith(place)}

    def accepted(self, values: Mapping[str, float]) -> dict[str, float]:
        first, second = (part.accepted(self.values_of(part, values)) for part in self.both)
        return self.joined(first, second)

    def neutral(self) -> dict[str, float]:
        first, second = (part.neutral() for part in self.both)
        return self.joined(first, second)

    def parameter(self, name: str) -> Parameter:
        place, own = name.split(".", 1)
        return self.both[int(place)].parameter(own)
