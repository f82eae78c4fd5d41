"""A command that has passed the gate. Nothing else can be sent to a hand: publishers take this type alone."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

_SEAL = object()


@dataclass(frozen=True, eq=False)
class Sendable:
    """Targets (k,) rad by command name, all finite and within their limits. Only `make_sendable` makes one."""

    number: int
    stamp_ns: int
    names: tuple[str, ...]
    position: np.ndarray
    mark: object = field(repr=False)

    def __post_init__(self) -> None:
        if self.mark is not _SEAL:
            raise TypeError("only the gate makes a command sendable")


def make_sendable(number: int, stamp_ns: int, names: tuple[str, ...], position: np.ndarray) -> Sendable:
    """Makes a command sendable. For the gate alone; a test holds that nothing else calls it."""
    return Sendable(number, stamp_ns, names, position, _SEAL)
