"""Samples on their way from a file to arrays, kept compact: ten minutes at 1 kHz are 350 MB of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

_BLOCK = 1024


@dataclass
class Block:
    """n samples of k joints: `stamp_ns`, `received_ns` and `order` (n,) int64, the values (n, k) float64."""

    stamp_ns: np.ndarray
    received_ns: np.ndarray
    order: np.ndarray
    position: np.ndarray
    velocity: np.ndarray | None
    effort: np.ndarray | None


class Rows:
    """The samples of one kind of message: the same joints in the same order, with or without velocity and effort."""

    def __init__(self, names: Sequence[str], *, velocity: bool = False, effort: bool = False) -> None:
        self.names = tuple(names)
        self._present = {"position": True, "velocity": velocity, "effort": effort}
        self._stamps: list[np.ndarray] = []  # (3, n): stamp, receive time, order of arrival
        self._values: dict[str, list[np.ndarray]] = {"position": [], "velocity": [], "effort": []}
        self._loose_stamps: list[tuple[int, int, int]] = []
        self._loose: dict[str, list[Sequence[float] | np.ndarray]] = {"position": [], "velocity": [], "effort": []}

    def add(
        self,
        stamp_ns: int,
        received_ns: int,
        order: int,
        position: Sequence[float] | np.ndarray,
        velocity: Sequence[float] | np.ndarray = (),
        effort: Sequence[float] | np.ndarray = (),
    ) -> None:
        """One sample; velocity and effort count only where these rows have them."""
        self._loose_stamps.append((stamp_ns, received_ns, order))
        for key, values in (("position", position), ("velocity", velocity), ("effort", effort)):
            if self._present[key]:
                self._loose[key].append(values)
        if len(self._loose_stamps) >= _BLOCK:
            self._pack()

    def add_block(self, block: Block) -> None:
        """Many samples at once."""
        self._pack()
        self._stamps.append(np.stack([block.stamp_ns, block.received_ns, block.order]))
        for key, values in (("position", block.position), ("velocity", block.velocity), ("effort", block.effort)):
            if self._present[key] and values is not None:
                self._values[key].append(values)

    def take(self) -> Block | None:
        """Everything as one block, by order of arrival. These rows are empty afterwards: no number is held twice."""
        self._pack()
        if not self._stamps:
            return None
        stamps = np.concatenate(self._stamps, axis=1)
        self._stamps.clear()
        by_order = None if (np.diff(stamps[2]) > 0).all() else np.argsort(stamps[2], kind="stable")
        if by_order is not None:
            stamps = stamps[:, by_order]
        position, velocity, effort = (self._joined(key, by_order) for key in ("position", "velocity", "effort"))
        assert position is not None
        return Block(stamps[0], stamps[1], stamps[2], position, velocity, effort)

    def _pack(self) -> None:
        if not self._loose_stamps:
            return
        self._stamps.append(np.array(self._loose_stamps, dtype=np.int64).T)
        self._loose_stamps = []
        for key, values in self._loose.items():
            if self._present[key]:
                self._values[key].append(np.array(values, dtype=np.float64))
                self._loose[key] = []

    def _joined(self, key: str, by_order: np.ndarray | None) -> np.ndarray | None:
        if not self._present[key]:
            return None
        joined = np.concatenate(self._values[key])
        self._values[key].clear()
        return joined if by_order is None else joined[by_order]
