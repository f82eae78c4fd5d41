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


class _Growing:
    """Rows (n, k) float64 in one piece of memory that grows in place: no number is ever held or copied twice.

    Room for the rows that are `expected` is not touched before they come; growing touches all that it adds.
    """

    def __init__(self, columns: int, expected: int) -> None:
        try:
            self._array = np.empty((expected, columns))
        except (MemoryError, ValueError):  # a file may announce what no machine can hold
            self._array = np.empty((0, columns))
        self._length = 0

    def extend(self, rows: np.ndarray) -> None:
        end = self._length + len(rows)
        if end > len(self._array):
            self._array.resize((max(end, 2 * len(self._array)), self._array.shape[1]), refcheck=False)
        self._array[self._length : end] = rows
        self._length = end

    def take(self) -> np.ndarray:
        """All of them; nothing is left."""
        array, self._array = self._array, np.empty((0, self._array.shape[1]))
        array.resize((self._length, array.shape[1]), refcheck=False)
        self._length = 0
        return array


class Rows:
    """The samples of one kind of message: the same joints in the same order, with or without velocity and effort."""

    def __init__(
        self, names: Sequence[str], *, velocity: bool = False, effort: bool = False, expected: int = 0
    ) -> None:
        self.names = tuple(names)
        present = {"position": True, "velocity": velocity, "effort": effort}
        self._stamps: list[np.ndarray] = []  # (3, n): stamp, receive time, order of arrival
        self._values = {key: _Growing(len(self.names), expected) for key, here in present.items() if here}
        self._loose_stamps: list[tuple[int, int, int]] = []
        self._loose: dict[str, list[Sequence[float] | np.ndarray]] = {key: [] for key in self._values}

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
            if key in self._loose:
                self._loose[key].append(values)
        if len(self._loose_stamps) >= _BLOCK:
            self._pack()

    def add_block(self, block: Block) -> None:
        """Many samples at once."""
        self._pack()
        self._stamps.append(np.stack([block.stamp_ns, block.received_ns, block.order]))
        for key, values in (("position", block.position), ("velocity", block.velocity), ("effort", block.effort)):
            if key in self._values and values is not None:
                self._values[key].extend(values)

    def take(self) -> Block | None:
        """Everything as one block, by order of arrival. These rows are empty afterwards."""
        self._pack()
        if not self._stamps:
            return None
        stamps = np.concatenate(self._stamps, axis=1)
        self._stamps.clear()
        found = {key: values.take() for key, values in self._values.items()}
        if not (np.diff(stamps[2]) > 0).all():
            by_order = np.argsort(stamps[2], kind="stable")
            stamps = stamps[:, by_order]
            found = {key: values[by_order] for key, values in found.items()}
        return Block(stamps[0], stamps[1], stamps[2], found["position"], found.get("velocity"), found.get("effort"))

    def _pack(self) -> None:
        if not self._loose_stamps:
            return
        self._stamps.append(np.array(self._loose_stamps, dtype=np.int64).T)
        self._loose_stamps = []
        for key, values in self._loose.items():
            self._values[key].extend(np.array(values, dtype=np.float64))
            self._loose[key] = []
