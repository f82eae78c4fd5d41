"""What can be wrong with the messages of a hand's driver, whatever its mechanics do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand import Hand, match

Readings = tuple[tuple[str, ...], np.ndarray, np.ndarray, np.ndarray]


class Hardware(Protocol):
    """What takes targets and tells joint states."""

    def set_targets(self, targets: dict[str, float]) -> None: ...

    def advance(self, dt_s: float) -> None: ...

    def measure(self) -> Readings: ...


@dataclass(frozen=True)
class Fault:
    """A fault of the readings of one joint, or of all (None)."""

    kind: str
    joint: str | None = None


FAULTS: dict[str, str] = {
    "degrees": "the driver tells degrees for rad",
    "dead": "the encoder tells for ever what it told first",
    "reversed": "the encoder counts the wrong way",
}


def parse_fault(text: str, hand: Hand) -> Fault:
    """`dead:rh_FFJ3`, `degrees`. Raises BadInput."""
    kind, _, name = (part.strip() for part in text.partition(":"))
    if kind not in FAULTS:
        raise BadInput(f"no fault '{kind}'", where=text, todo=nearest(kind, FAULTS))
    joint = match(name, hand.joints) if name else None
    if name and joint is None:
        raise BadInput(f"no joint '{name}'", where=text, todo=nearest(name, hand.joints))
    return Fault(kind, joint)


class Faulty:
    """Hardware whose readings are wrong."""

    def __init__(self, plant: Hardware, faults: Sequence[Fault]) -> None:
        self._plant = plant
        self._faults = faults
        self._first: np.ndarray | None = None

    def set_targets(self, targets: dict[str, float]) -> None:
        self._plant.set_targets(targets)

    def advance(self, dt_s: float) -> None:
        self._plant.advance(dt_s)

    def measure(self) -> Readings:
        names, position, velocity, effort = self._plant.measure()
        position, velocity = position.copy(), velocity.copy()
        if self._first is None:
            self._first = position.copy()
        for fault in self._faults:
            rows = slice(None) if fault.joint is None else [names.index(fault.joint)]
            if fault.kind == "dead":
                position[rows], velocity[rows] = self._first[rows], 0.0
            else:
                factor = np.degrees(1.0) if fault.kind == "degrees" else -1.0
                position[rows] *= factor
                velocity[rows] *= factor
        return names, position, velocity, effort
