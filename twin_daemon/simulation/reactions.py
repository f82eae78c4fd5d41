"""What joints and links outside a sub-model do to it while they move, as torques."""

from __future__ import annotations

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

    def torque(self, moved: np.ndarray | None = None) -> np.ndarray: ...


_NEARBY = 0.02  # rad or m: far enough for a difference, near enough for a slope


@dataclass(frozen=True)
class _Torques:
    """The torques along a motion, computed once for all pieces of a recording."""

    source: Prescribed

    @cached_property
    def nominal(self) -> np.ndarray:
        """(m, k) N m (N for slides)."""
        return self.source.torque()

    @cached_property
    def slopes(self) -> np.ndarray:
        """(m, k, k) how they change with the true position of each joint, the last index."""
        count = len(self.source.joints)
        moved = [self.source.torque(_NEARBY * np.eye(count)[joint]) for joint in range(count)]
        return np.stack([(torque - self.nominal) / _NEARBY for torque in moved], axis=2)


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

    `torques` is None where the joints outside are still; `links` is what uncertain masses of links may add.
    """

    torques: _Torques | None
    begin_s: float = 0.0
    links: LinkLoads | None = None

    @classmethod
    def along(cls, source: Prescribed) -> Reaction:
        return cls(_Torques(source))

    def shifted(self, begin_s: float) -> Reaction:
        """The same with times counted from `begin_s`."""
        return replace(self, begin_s=self.begin_s + begin_s)

    def applied(self, twin: TwinModel, time_s: np.ndarray, measurement: Measurement | None = None) -> np.ndarray:
        """(T, nv) generalised forces for a roll-out of the sub-model at times (T,) s, linear in between.

        With another `measurement` than the motion was read with, the joints were elsewhere than they seemed.
        """
        out = np.zeros((len(time_s), twin.model.nv))
        if self.torques is None:
            return out
        source = self.torques.source
        torque = self.torques.nominal
        if measurement is not None:
            seen = source.measurement.apply(source.joints, source.position)
            moved = measurement.invert(source.joints, seen) - source.position
            if moved.any():
                torque = torque + np.einsum("mkj,mj->mk", self.torques.slopes, moved)
        for column, joint in enumerate(source.joints):
            dof = twin.dof_adr[twin.joints.index(joint)]
            out[:, dof] = np.interp(time_s + self.begin_s, source.time_s, torque[:, column])
        return out

    def applied_by_links(self, twin: TwinModel, time_s: np.ndarray) -> np.ndarray:
        """(T, nv, q) generalised forces by sigma of each combination of link masses."""
        assert self.links is not None
        return self.links.applied(twin, time_s + self.begin_s)
