"""Where joints have turned before a roll-out begins: what the bristles of dry friction remember of the motion."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

Bent = Callable[[float], float | None]
"""How far, from -1 to 1, a bristle that gives way over so many rad is bent; None where nothing says that."""

_RESOLVED = 3.0  # times the smallest way that is told from noise: one that gives way sooner forgets before it shows
_FORGOTTEN = 0.1  # of what a bristle was bent by before it was seen


@dataclass(frozen=True)
class Turns:
    """`angles` has for each joint (k,) rad where it was first seen, where it turned, and where it is.

    `least_rad` (j,) is the smallest way between two turns that is told from noise.
    """

    angles: tuple[np.ndarray, ...]
    least_rad: np.ndarray

    def by_dof(self, dofs: Sequence[int]) -> dict[int, Bent]:
        """`bent` of each joint, by its degree of freedom in a model (j,)."""
        return {int(dof): functools.partial(self.bent, joint) for joint, dof in enumerate(dofs)}

    def bent(self, joint: int, way_rad: float) -> float | None:
        """How far a bristle that gives way over `way_rad` is bent, from -1 to 1, by Dahl's law.

        None where the sensor does not tell so short a way from noise, or too little was seen of a long one.
        """
        ways = np.diff(self.angles[joint])
        if way_rad < _RESOLVED * self.least_rad[joint] or np.exp(-np.abs(ways).sum() / way_rad) > _FORGOTTEN:
            return None
        share = 0.0
        for towards, kept in zip(np.sign(ways), np.exp(-np.abs(ways) / way_rad), strict=True):
            share = towards + (share - towards) * kept
        return float(share)


def turning_points(angle: np.ndarray, least_rad: float) -> list[int]:
    """The samples at which an angle (n,) rad turns by more than `least_rad`, the first that is known before them."""
    known = np.flatnonzero(np.isfinite(angle))
    if not known.size:
        return []
    found, extreme, way = [int(known[0])], int(known[0]), 0.0
    values: Sequence[float] = angle.tolist()
    for index in known[1:].tolist():
        gone = values[index] - values[extreme]
        if way * gone > 0.0:
            extreme = index
        elif abs(gone) > least_rad:
            if way:
                found.append(extreme)
            way, extreme = gone, index
    return found
