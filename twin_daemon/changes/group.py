"""One group of joints with both sessions, as well as they are explained without any change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from twin_daemon.changes.healthy_model import settled
from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.quantities import Quantity
from twin_daemon.changes.sessions import Session
from twin_daemon.estimation.nuisances import nuisance_variables
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.posterior import Correction, floor_and_corrections
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Believed:
    """What is known of shared amounts before: centre and sigma of z by a quantity's name."""

    centre: Mapping[str, float] = field(default_factory=dict)
    sigma: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Sessions:
    """Pieces of a group's motion: of the earlier session (none where a version stands for it), of the later one, and of
    the later one's that is held out."""

    before: tuple[Aligned, ...]
    now: tuple[Aligned, ...]
    held: tuple[Aligned, ...] = ()


@dataclass(frozen=True, eq=False)
class Group:
    """A group of joints whose sessions are compared.

    `without` is the best fit without any change, `start` where the earlier session's own fit ends, None where a version
    stands for it. `floor` (k,) rad^2 is what nothing can explain.
    """

    reduced: Reduced
    sessions: Sessions
    pair: Pair
    start: Fit | None
    without: Fit
    floor: np.ndarray

    @property
    def strain(self) -> float:
        """The cost of the later session without any change, with that of values that go far for it, over the earlier's.

        Both by sample. Of a version that stands for the earlier one over what its noise is taken for.
        """
        before, squares = self.pair.before, self.without.rows**2
        size = len(before.weights) if before else 0
        earlier = float(squares[:size].sum())
        later = (self.without.cost - earlier) / (len(squares) - size)
        return later / max(earlier / size, 1e-30) if size else later

    def held(self, every: tuple[Quantity, ...]) -> Session | None:
        """What is held out of the later session, with these quantities."""
        twin, joints = self.reduced.twin, self.reduced.joints
        return _session(twin, self.sessions.held, joints, every, self.floor) if self.sessions.held else None


def group_of(
    reduced: Reduced,
    sessions: Sessions,
    every: tuple[Quantity, ...],
    believed: Believed | None = None,
) -> Group:
    """One group before anything is looked for, with these quantities of it."""
    twin, joints = reduced.twin, reduced.joints
    floor, _ = _floor(twin, sessions.before or sessions.now, joints)
    earlier = _session(twin, sessions.before, joints, every, floor) if sessions.before else None
    later = _session(twin, sessions.now, joints, every, floor)
    known = believed or Believed()
    means = np.array([known.centre.get(q.name, 0.0) for q in every])
    sigmas = np.array([known.sigma.get(q.name, q.shared_sigma) for q in every])
    pair, start = settled(Pair(earlier, later, means, sigmas))
    return Group(reduced, sessions, pair, start, pair.fit((), start), floor)


def _floor(twin: TwinModel, pieces: Sequence[Aligned], joints: Sequence[str]) -> tuple[np.ndarray, list[Correction]]:
    return floor_and_corrections(twin, pieces, nuisance_variables(twin, pieces, joints), joints)


def _session(
    twin: TwinModel,
    pieces: tuple[Aligned, ...],
    joints: tuple[str, ...],
    every: tuple[Quantity, ...],
    floor: np.ndarray,
) -> Session:
    return Session(twin, pieces, joints, every, floor, _floor(twin, pieces, joints)[1])
