"""One cause of several groups of joints with its values: where it begins, where it is fitted to, what it leaves.

Each group is looked at on its own model; the value is one for all. With the nuisances of every group projected out the
cost is a sum over groups, so that a cause of the whole robot costs some roll-outs of small models.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np

from twin_daemon.diagnosis.as_fitted import looked_at_again
from twin_daemon.diagnosis.group import GroupRows, at_nominal, look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.shared_cause import Cause, SharedCause
from twin_daemon.diagnosis.thresholds import (
    RELATIVE_ERROR,
    SHARED_DAMPING,
    SHARED_HALVINGS,
    SHARED_LAST_STEPS,
    SHARED_SETTLED_NATS,
    SHARED_SHARES,
    SHARED_STEPS,
    SHARED_TAKEN,
    SHARED_TELLING,
)
from twin_daemon.errors import BadInput
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.estimation.uncertainty import inflation
from twin_daemon.executor import concurrently
from twin_daemon.places import ROBOT
from twin_daemon.simulation.submodel import linked
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Begun:
    """A cause with values, and what all groups leave with it: rows (m,), and the price of what refines it.

    `near` says that a fit has taken it there, to some of the groups at least.
    """

    cause: Cause
    values: dict[str, float]
    rows: np.ndarray
    price: float = 0.0
    near: bool = False

    @property
    def cost(self) -> float:
        return float(self.rows @ self.rows) + self.price

    @property
    def scales(self) -> dict[str, float]:
        """What is a large change of each value that is moved; of a share that has no typical one all of it."""
        typical = self.cause.typical
        return {name: max(abs(self.values[name]), abs(typical(name))) or 1.0 for name in self.cause.amplitudes}

    @property
    def effects(self) -> frozenset[str]:
        """The names of what it is made of."""
        return frozenset(part.name for part in self.cause.parts)


class SharedFit:
    """Several groups, and what a cause that all of them feel leaves of each."""

    def __init__(self, twin: TwinModel, reduction: Reduction, above: Sequence[tuple[Reduced, PartFit]]) -> None:
        self._twin, self._reduction, self._above = twin, reduction, list(above)
        self._groups = concurrently(lambda item: GroupRows(*item), self._above)
        self._nothing = np.concatenate([group.rows for group in self._groups])

    def only(self, chosen: Sequence[int]) -> Self:
        """The same search for some of its groups."""
        other = copy.copy(self)
        other._above, other._groups = [self._above[i] for i in chosen], [self._groups[i] for i in chosen]
        other._nothing = np.concatenate([group.rows for group in other._groups])
        return other

    def above(self, floors: float) -> list[int]:
        """The groups that leave more than so many floors with what their nuisances can do."""
        return np.flatnonzero(concurrently(lambda group: group.above(floors), self._groups)).tolist()

    @property
    def _cost_without(self) -> float:
        """What all groups leave without any cause."""
        return float(self._nothing @ self._nothing)

    @property
    def _floor_cost(self) -> float:
        """What the floors of all groups come to."""
        return sum(group.floor_cost for group in self._groups)

    @property
    def _most_cost(self) -> float:
        """What a cause may leave of all rows and still take its share of what is above the floor from most groups."""
        above = sorted(float(group.rows @ group.rows) - group.floor_cost for group in self._groups)
        return self._cost_without - SHARED_TAKEN * sum(max(one, 0.0) for one in above[: len(above) // 2 + 1])

    def _takes_all(self, begun: Begun) -> bool:
        """Whether a cause leaves of what is above the floor no more than a right law does."""
        return begun.cost - self._floor_cost <= RELATIVE_ERROR * (self._cost_without - self._floor_cost)

    def _helps_most(self, begun: Begun) -> bool:
        """Whether a cause takes its share of what is above the floor from most groups, or brings them to it."""
        return self._share_helped(begun.rows) > 0.5

    def _share_helped(self, rows: np.ndarray, taken: float = SHARED_TAKEN) -> float:
        """Of the groups those that rows (m,) leave at their floor, or without so much of what is above that."""
        helped = 0
        for group, left in zip(self._groups, self._split(rows), strict=True):
            nothing, floor = float(group.rows @ group.rows), group.floor_cost
            helped += float(left @ left) <= max(FLOOR_CHI_SQUARE * floor, nothing - taken * (nothing - floor))
        return helped / len(self._groups)

    def _split(self, rows: np.ndarray) -> list[np.ndarray]:
        """Rows (m, ...) of all groups by group."""
        return np.split(rows, np.cumsum([len(group.rows) for group in self._groups])[:-1])

    def _changed(self, cause: Cause, values: Mapping[str, float]) -> list[Reduced]:
        if not cause.is_load:
            return [
                Reduced(r.name, r.joints, r.twin.changed(cause.terms(r.twin, values)), r.train, r.holdout)
                for r, _ in self._above
            ]
        whole = self._twin.changed(cause.terms(self._twin, values))
        found = [self._reduction.anew(whole, reduced) for reduced, _ in self._above]
        return [reduced for reduced in found if reduced is not None]

    def _rows(self, cause: Cause, values: Mapping[str, float]) -> np.ndarray:
        """(m,) what all groups leave with a cause of these values."""
        changed = self._changed(cause, values)
        seen = [group.seen(reduced) for group, reduced in zip(self._groups, changed, strict=True)]
        return np.nan_to_num(np.concatenate(seen), nan=1e3, posinf=1e3, neginf=-1e3)

    def begun(self, cause: SharedCause) -> list[Begun]:
        """A cause at the best of its starts for each of its forms, the best first; none where it cannot act.

        How strong a load or a delay may be follows from no scale of one place, so that shares go over decades. Forms
        differ in what no fit moves, such as how much of a friction sticks: which is the better says only its fit.
        What all servos or joints have alike a few groups say as well as all: where these take it to it begins.
        """
        telling = self._most_telling() if cause.target == ROBOT else []
        if telling:
            few = self.only(telling)
            told = [self._at(cause, few.fitted(one)[0].values) for one in few.begun(cause)]
            return sorted((replace(one, near=True) for one in told if one is not None), key=lambda one: one.cost)
        starts = self._starts(cause)
        outwards = cause.directions(starts)
        found: list[Begun] = []
        if cause.is_load:
            for start in outwards:
                found += self._projected(cause, partial(cause.along, start), self._nothing)
        else:
            begun = [(start, 1.0) for start in starts]
            begun += [(start, share) for start in outwards for share in SHARED_SHARES[1:]]
            every = [self._at(cause, cause.along(start, share)) for start, share in begun]
            found = [one for one in every if one is not None]
        best: dict[tuple[float, ...], Begun] = {}
        for one in sorted(found, key=lambda one: one.cost):
            best.setdefault(cause.form(one.values), one)
        return list(best.values())

    def _most_telling(self) -> list[int]:
        """Of many groups the few that are the furthest above their floors; none where so few are above them.

        What none of them shows by itself only all of them together do.
        """
        floor = np.array([group.floor_cost for group in self._groups])
        cost = np.array([float(group.rows @ group.rows) for group in self._groups])
        above = [index for index in np.argsort(cost - floor).tolist() if cost[index] > FLOOR_CHI_SQUARE * floor[index]]
        return sorted(above[-SHARED_TELLING:]) if len(self._groups) > SHARED_TELLING <= len(above) else []

    def _starts(self, cause: SharedCause) -> tuple[dict[str, float], ...]:
        return cause.starts(self._twin, [joint for reduced, _ in self._above for joint in reduced.joints])

    def at(self, cause: Cause, values: Mapping[str, float]) -> Begun:
        """A cause at known values."""
        complete = cause.accepted(values)
        return Begun(cause, complete, self._rows(cause, complete), self._price(cause))

    def _price(self, cause: Cause) -> float:
        """What it costs that a cause is refined, by the Bayesian information criterion."""
        return sum(len(part.refining) for part in cause.parts) * float(np.log(self._floor_cost))

    def estimates(self, found: Begun, slopes: np.ndarray) -> dict[str, Estimate]:
        """A fitted cause's values with their intervals, from the slopes (m, q) of the rows."""
        samples = self._floor_cost
        fitted = slopes.shape[1] + sum(len(part.variables) for _, part in self._above)
        inflated = inflation(found.cost / samples, samples, fitted)
        return found.cause.estimates(self._twin, found.values, slopes, inflated)

    def beside(self, cause: Cause, values: Mapping[str, float]) -> list[tuple[Reduced, PartFit]]:
        """The groups with a cause in their models, and what is uncertain about them fitted beside it."""
        changed = self._changed(cause, values)
        if cause.is_load:
            return concurrently(look, changed)
        # the groups are as they were but for a value that has moved a little: so is their floor
        return concurrently(lambda one: look(*one), list(zip(changed, [part for _, part in self._above], strict=True)))

    def joined(self, twin: TwinModel) -> list[tuple[Reduced, PartFit]]:
        """The groups as a twin has them, those that carry one another as one; none where one touches something."""
        groups = [reduced for reduced, _ in self._above]
        units = linked(twin, [group.joints for group in groups])
        found = [self._reduction.together(twin, [groups[index] for index in members]) for members in units]
        whole = [reduced for reduced in found if reduced is not None]
        return concurrently(look, whole) if len(whole) == len(found) else []

    def _at(self, cause: Cause, values: dict[str, float]) -> Begun | None:
        """A cause at some values; None where it cannot stand beside what the twin has."""
        with contextlib.suppress(BadInput):
            return self.at(cause, values)
        return None

    def _projected(self, cause: Cause, along: Callable[[float], dict[str, float]], without: np.ndarray) -> list[Begun]:
        """A load, whose torques grow in proportion to it, as strong as a light one says that it should be.

        `along` gives the values of a share of a start, `without` (m,) are the rows of none. What is further than the
        motion stays in proportion would be worse than the light one, and is halved.
        """
        found: list[Begun] = []
        step = share = SHARED_SHARES[-1]
        for _ in range(SHARED_HALVINGS):
            step, light = share, self._at(cause, along(share))
            if light is None:
                return found
            found.append(light)
            change = (light.rows - without) / step
            share = float(np.clip(-(change @ without) / max(change @ change, 1e-30), 0.0, 1.0))
            if not 0.0 < share < step:
                break  # else it is too heavy itself, and a lighter one says more
        for _ in range(SHARED_HALVINGS + 1):
            full = self._at(cause, along(share)) if share > step else None
            if full is not None:
                found.append(full)
            if full is None or full.cost < found[0].cost:
                break
            share *= 0.5
        return found

    def fitted(self, begun: Begun, reach: float = np.inf, *, settling: bool = False) -> tuple[Begun, np.ndarray]:
        """(where Gauss-Newton takes a cause, (m, q) slopes there); what comes to no cost within `reach` is left.

        So is what cannot help most groups, unless it is `settling` where all groups have it.

        Friction makes slopes over a tenth of a value another thing than slopes nearby, so that each round looks nearer,
        and a step that gains nothing is halved. What a fit has taken near its end already needs the last rounds only.
        """
        cause, near = begun.cause, begun.near
        slopes = np.empty((len(begun.rows), 0))
        for count, share in enumerate(SHARED_STEPS[-SHARED_LAST_STEPS:] if near else SHARED_STEPS):
            steps = {n: share * scale for n, scale in begun.scales.items()}
            stepped = [begun.values | {name: begun.values[name] + step} for name, step in steps.items()]
            found = concurrently(lambda values: self._rows(cause, values), stepped)
            slopes = np.column_stack([(r - begun.rows) / step for r, step in zip(found, steps.values(), strict=True)])
            move = np.linalg.lstsq(slopes, -begun.rows, rcond=None)[0]
            expected = begun.cost - float(((begun.rows + slopes @ move) ** 2).sum())
            # where a cause begins its slopes may promise too little, so that it is moved once
            within = min(reach, self._most_cost) if (count or near) and not settling else np.inf
            if 0.5 * expected < SHARED_SETTLED_NATS or begun.cost - expected > within:
                break
            begun = self._moved(begun, slopes)
        return replace(self._without_idle(begun, slopes), near=True), slopes

    def _in_detail(self, found: Begun) -> Begun:
        """A fitted cause with what refines it, where most groups feel it, one is above its floor and that pays."""
        finer = found.cause.in_detail()
        if finer is None or not self._helps_most(found) or self._at_every_floor(found):
            return found
        again, _ = self.fitted(self.at(finer, found.values))
        return again if again.cost < found.cost and finer.possible(self._twin, again.values) else found

    def _at_every_floor(self, begun: Begun) -> bool:
        """Whether a cause brings each of the groups to its floor."""
        both = zip(self._groups, self._split(begun.rows), strict=True)
        return all(float(left @ left) <= FLOOR_CHI_SQUARE * group.floor_cost for group, left in both)

    def _without_idle(self, begun: Begun, slopes: np.ndarray) -> Begun:
        """A cause with those values back at neutral that do nothing where they are, such as a limit never reached."""
        neutral, idle = begun.cause.neutral(), {}
        for name, column in zip(begun.cause.amplitudes, slopes.T, strict=True):
            if float(np.linalg.norm(column)) * abs(begun.values[name] - neutral[name]) < 1.0:
                idle[name] = neutral[name]
        without = self.at(begun.cause, begun.values | idle) if 0 < len(idle) < len(begun.cause.amplitudes) else begun
        return without if without.cost < begun.cost + 1.0 else begun

    def _moved(self, begun: Begun, slopes: np.ndarray) -> Begun:
        """A cause after a step of its values by the slopes (m, q) of its rows, as much of it as lowers the cost.

        A smaller one is also more one along what the rows know best: what they hardly know would go far.
        """
        cause = begun.cause
        scales = np.array(list(begun.scales.values()))
        left, sizes, right = np.linalg.svd(slopes * scales, full_matrices=False)
        along = left.T @ -begun.rows
        for halving, damping in enumerate(SHARED_DAMPING):
            shares = sizes / np.maximum(sizes**2 + damping * sizes.max() ** 2, 1e-300)
            move = 0.5**halving * scales * (right.T @ (shares * along))
            moved = {n: begun.values[n] + float(m) for n, m in zip(cause.amplitudes, move, strict=True)}
            trial = self.at(cause, begun.values | moved)
            if trial.cost < begun.cost:
                return trial
        return begun

    def settled(self, begun: Begun) -> tuple[Begun, np.ndarray, Self]:
        """As `fitted`, and once more with what nuisances can do taken where that has come to; and the search there.

        There the measured motion is smoothed by a twin that has the cause, and follows it better.
        """
        cause, found = begun.cause, self.fitted(begun)[0]
        twin = self._twin.changed(cause.terms(self._twin, found.values))
        reduction = self._reduction.following(twin)
        there = type(self)(twin, reduction, looked_at_again(twin, reduction, [r for r, _ in self._above], at_nominal))
        return (*there.fitted(there.at(cause, found.values), settling=True), there)
