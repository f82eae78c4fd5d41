"""One group of joints with both sessions, as well as they are explained without any change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from twin_daemon.changes.healthy_model import settled
from twin_daemon.changes.joint_fit import Fit, Pair
from twin_daemon.changes.quantities import Quantity
from twin_daemon.changes.sessions import Session
from twin_daemon.changes.thresholds import SHORT_STEP, WITHIN
from twin_daemon.estimation.nuisances import nuisance_variables
from twin_daemon.estimation.partition import Reduced
from twin_daemon.estimation.posterior import Correction, floor_and_corrections
from twin_daemon.estimation.thresholds import FINER_STEPS
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

    def held(self, every: tuple[Quantity, ...]) -> Session | None:
        """What is held out of the later session, with these quantities."""
        pieces, twin = self.sessions.held, self.reduced.twin
        return _session(self.reduced, twin, pieces, every, self.floor) if pieces else None


@dataclass(frozen=True, eq=False)
class Begun:
    """A group of joints with the plain fit of its earlier session, None where a version stands for it."""

    reduced: Reduced
    sessions: Sessions
    believed: Believed
    pair: Pair
    alone: Fit | None
    floor: np.ndarray

    @property
    def is_off(self) -> bool:
        """Whether that fit leaves more than a right model does."""
        return self.alone is not None and _is_off(self.alone)

    @property
    def values(self) -> dict[str, float]:
        """The model's own parameters as they were fitted, by name."""
        pairs = zip(self.pair.now.quantities, self.alone.point if self.alone else (), strict=False)
        return {q.name: float(q.value(float(z)) or 0.0) for q, z in pairs if q.is_parameter}


def begun(
    reduced: Reduced,
    sessions: Sessions,
    every: tuple[Quantity, ...],
    believed: Believed | None = None,
    values: Mapping[str, float] | None = None,
) -> Begun:
    """One group with these quantities of it, its earlier session fitted with the model's own parameters.

    `values` are parameters by name at which the error of the model's time step is taken; its own where none are given.
    """
    at = _with(reduced.twin, every, values or {})
    floor, _ = _floor(at, sessions.before or sessions.now, reduced.joints)
    earlier = _session(reduced, at, sessions.before, every, floor) if sessions.before else None
    later = _session(reduced, at, sessions.now, every, floor)
    known = believed or Believed()
    means = np.array([known.centre.get(q.name, 0.0) for q in every])
    sigmas = np.array([known.sigma.get(q.name, q.shared_sigma) for q in every])
    pair = Pair(earlier, later, means, sigmas)
    return Begun(reduced, sessions, known, pair, _alone(pair.baseline_only()) if earlier else None, floor)


def _alone(pair: Pair) -> Fit:
    """The earlier session's own fit.

    A servo at its limit says only what brakes the joint, and does so with force: the first step of one sigma takes all
    other values to where they help with that, and the way back may be closed. Short steps keep out of there.
    """
    found = pair.fit(())
    return min(found, pair.fit((), radius=SHORT_STEP), key=lambda one: one.cost) if _is_off(found) else found


def _is_off(alone: Fit) -> bool:
    before = alone.pair.before
    return before is not None and float((alone.rows**2).sum()) > WITHIN * before.floor_cost


def group_of(one: Begun) -> Group:
    """A group before any change is looked for, with the effects that its earlier session shows.

    Where it shows any, or the later one is off without, all is done at a finer time step: what steps get wrong is
    known of the model alone. A brake that sticks is further off, and another effect takes that away.
    """
    found = _opened(one)
    if one.alone is None or not (found.pair.now.active or found.without.asks_for_an_effect):
        return found
    twin = one.reduced.twin
    finer = replace(one.reduced, twin=twin.at_step(float(twin.model.opt.timestep) / FINER_STEPS))
    return _opened(begun(finer, one.sessions, one.pair.now.quantities, one.believed, one.values))


def _opened(one: Begun) -> Group:
    pair, start = settled(one.pair, one.alone)
    return Group(one.reduced, one.sessions, pair, start, pair.fit((), start), one.floor)


def _floor(twin: TwinModel, pieces: Sequence[Aligned], joints: Sequence[str]) -> tuple[np.ndarray, list[Correction]]:
    return floor_and_corrections(twin, pieces, nuisance_variables(twin, pieces, joints), joints)


def _with(twin: TwinModel, every: Sequence[Quantity], values: Mapping[str, float]) -> TwinModel:
    """The twin with those of these values that are its own."""
    own = {q.name: values[q.name] for q in every if q.name in values}
    parameters = twin.terms.parameters | own
    return twin.changed(twin.terms.model_copy(update={"parameters": parameters})) if own else twin


def _session(
    reduced: Reduced, at: TwinModel, pieces: tuple[Aligned, ...], every: tuple[Quantity, ...], floor: np.ndarray
) -> Session:
    return Session(reduced.twin, pieces, reduced.joints, every, floor, _floor(at, pieces, reduced.joints)[1])
