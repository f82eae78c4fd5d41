"""What joints and links outside a sub-model do to it while they move, as torques."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from twin_daemon.effects.base import Measurement

if TYPE_CHECKING:
    from twin_daemon.simulation.twin import TwinModel


class Prescribed(Protocol):
    """A motion of a whole robot, and what it takes to make a sub-model follow."""

    @property
    def time_s(self) -> np.ndarray: ...

    @property
    def joints(self) -> tuple[str, ...]: ...

    @property
    def measurement(self) -> Measurement: ...

    @property
    def position(self) -> np.ndarray: ...

    def torque(self, rows: slice, moved: np.ndarray | None = None) -> np.ndarray: ...


_BLOCK = 256  # times whose torques are computed at once: a piece of a recording asks for some of them
_NEARBY = 0.02  # rad or m: far enough for a difference, near enough for a slope


class Blocks:
    """Rows along a motion, computed where they are asked for, a block at a time and once for all its pieces."""

    def __init__(self, count: int, compute: Callable[[slice], np.ndarray]) -> None:
        self._count, self._compute = count, compute
        self._known: dict[int, np.ndarray] = {}

    def __call__(self, rows: slice) -> np.ndarray:
        """(len(rows), ...) of the rows from `rows.start` up to `rows.stop`."""
        first = rows.start // _BLOCK
        found = np.concatenate([self._block(index) for index in range(first, (rows.stop - 1) // _BLOCK + 1)])
        return found[rows.start - first * _BLOCK : rows.stop - first * _BLOCK]

    def _block(self, index: int) -> np.ndarray:
        if index not in self._known:
            self._known[index] = self._compute(slice(index * _BLOCK, min((index + 1) * _BLOCK, self._count)))
        return self._known[index]


@dataclass(frozen=True)
class _Torques:
    """The torques along a motion."""

    source: Prescribed

    @cached_property
    def nominal(self) -> Blocks:
        """(m, k) N m (N for slides)."""
        return Blocks(len(self.source.time_s), self.source.torque)

    @cached_property
    def slopes(self) -> Blocks:
        """(m, k, k) how they change with the true position of each joint, the last index."""
        return Blocks(len(self.source.time_s), self._differences)

    def _differences(self, rows: slice) -> np.ndarray:
        count = len(self.source.joints)
        moved = [self.source.torque(rows, _NEARBY * np.eye(count)[joint]) for joint in range(count)]
        return np.stack([(torque - self.nominal(rows)) / _NEARBY for torque in moved], axis=2)


@dataclass(frozen=True)
class LinkLoads:
    """Torques (m, k, q) N m on k joints at `time_s` (m,), one for each sigma of q combinations of link masses."""

    time_s: np.ndarray
    joints: tuple[str, ...]
    torque: np.ndarray

    def applied(self, twin: TwinModel, time_s: np.ndarray) -> np.ndarray:
        """(T, nv, q) generalised forces of a sub-model at times (T,) s, linear in between."""
        out = np.zeros((len(time_s), twin.model.nv, self.torque.shape[2]))
        for column, joint in enumerate(self.joints):
            dof = twin.dof_adr[twin.joints.index(joint)]
            for mode in range(out.shape[2]):
                out[:, dof, mode] = np.interp(time_s, self.time_s, self.torque[:, column, mode])
        return out


@dataclass(frozen=True)
class Reaction:
    """Torques on a sub-model's joints along a recording that begins `begin_s` after the motion that they are from.

    `torques` is None where the joints outside are still; `links` is what uncertain masses of links may add. `scale` is
    a factor on the torques, to see what comes of an error of theirs.
    """

    torques: _Torques | None
    begin_s: float = 0.0
    links: LinkLoads | None = None
    scale: float = 1.0

    @classmethod
    def along(cls, source: Prescribed) -> Reaction:
        return cls(_Torques(source))

    def shifted(self, begin_s: float) -> Reaction:
        """The same with times counted from `begin_s`."""
        return replace(self, begin_s=self.begin_s + begin_s)

    def applied(self, twin: TwinModel, time_s: np.ndarray, measurement: Measurement | None = None) -> np.ndarray:
        """(T, nv) generalised forces for a roll-out of the sub-model at times (T,) s: means of a step around each.

        A held command moves the joints outside by a pulse that may be shorter than a step, and counts by its impulse.

        With another `measurement` than the motion was read with, the joints were elsewhere than they seemed.
        """
        out = np.zeros((len(time_s), twin.model.nv))
        if self.torques is None:
            return out
        source, at = self.torques.source, time_s + self.begin_s
        step_s = float(twin.model.opt.timestep)
        ends = np.append(at, at[-1] + step_s) - 0.5 * step_s
        rows = _around(source.time_s, ends)
        torque = self.torques.nominal(rows)
        if measurement is not None:
            position = source.position[rows]
            seen = source.measurement.apply(source.joints, position)
            moved = measurement.invert(source.joints, seen) - position
            if moved.any():
                torque = torque + np.einsum("mkj,mj->mk", self.torques.slopes(rows), moved)
        for column, joint in enumerate(source.joints):
            dof = twin.dof_adr[twin.joints.index(joint)]
            out[:, dof] = self.scale * _means(source.time_s[rows], torque[:, column], ends)
        return out

    def applied_by_links(self, twin: TwinModel, time_s: np.ndarray) -> np.ndarray:
        """(T, nv, q) generalised forces by sigma of each combination of link masses."""
        assert self.links is not None
        return self.links.applied(twin, time_s + self.begin_s)


def _means(middle_s: np.ndarray, values: np.ndarray, ends_s: np.ndarray) -> np.ndarray:
    """(T,) means between times (T + 1,) of what is constant in cells (m,) about their middles, and beyond these."""
    width = float(np.median(np.diff(middle_s))) if len(middle_s) > 1 else 1.0
    beyond = abs(ends_s[0] - middle_s[0]) + abs(ends_s[-1] - middle_s[-1]) + width
    widths = np.concatenate([[beyond], np.full(len(values), width), [beyond]])
    impulse = np.concatenate([[0.0], np.cumsum(widths * np.concatenate([values[:1], values, values[-1:]]))])
    edges = middle_s[0] - 0.5 * width - beyond + np.concatenate([[0.0], np.cumsum(widths)])
    return np.diff(np.interp(ends_s, edges, impulse)) / np.diff(ends_s)


def _around(grid_s: np.ndarray, time_s: np.ndarray) -> slice:
    """The cells of a grid in which all of the given times (T,) lie."""
    first = int(np.searchsorted(grid_s, time_s.min(), side="right")) - 1
    last = int(np.searchsorted(grid_s, time_s.max(), side="left")) + 1
    return slice(min(max(first, 0), len(grid_s) - 1), max(min(last, len(grid_s)), 1))
