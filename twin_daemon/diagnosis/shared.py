"""Causes that several groups of joints feel at once: a late bus, a weak supply, a tilted base, a load on a chain.

Each group is looked at on its own model; the value is one for all. With the nuisances of every group projected out the
cost is a sum over groups, so that a cause of the whole robot costs some roll-outs of small models.
"""

from __future__ import annotations

import contextlib
import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.diagnosis.as_fitted import looked_at_again
from twin_daemon.diagnosis.far_off import beyond_any_hand, deviating
from twin_daemon.diagnosis.group import GroupRows, at_nominal, look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.probability import posterior
from twin_daemon.diagnosis.shared_cause import SharedCause
from twin_daemon.diagnosis.shared_check import passing
from twin_daemon.diagnosis.thresholds import (
    COMPARABLE,
    DECISIVE_NATS,
    SHARED_FINALISTS,
    SHARED_HALVINGS,
    SHARED_SETTLED_NATS,
    SHARED_SHARES,
    SHARED_STEPS,
    SHARED_TAKEN,
)
from twin_daemon.diagnosis.verdict import Finding
from twin_daemon.errors import BadInput
from twin_daemon.estimation.estimate import Estimate
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.estimation.uncertainty import block_gain, inflation
from twin_daemon.executor import concurrently
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.submodel import linked
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Shared:
    """A cause that was accepted: its finding, its terms, and the groups with it in their models."""

    finding: Finding
    posterior: Mapping[str, float]
    terms: Terms
    looked_at: list[tuple[Reduced, PartFit]]

    @property
    def one_of_several(self) -> bool:
        """Whether it is a load at a joint beside which some value has to be further off than any plausible hand's.

        That value stands in for a second effect, beside which the load is another one.
        """
        sure = self.finding.target not in (ROBOT, HAND) and not self.finding.confusable_with
        return sure and any(_is_forced(part) for _, part in self.looked_at)

    @property
    def forced(self) -> list[tuple[Reduced, PartFit]]:
        """Of a cause of the whole robot the groups that may have an effect of their own beside it."""
        return [one for one in self.looked_at if self.finding.target == ROBOT and _is_forced(one[1])]

    @property
    def settled(self) -> list[tuple[Reduced, PartFit]]:
        """The others."""
        return [one for one in self.looked_at if not (self.finding.target == ROBOT and _is_forced(one[1]))]


def _is_forced(part: PartFit) -> bool:
    """Whether some uncertain value has to be further off than any plausible hand's."""
    return bool(beyond_any_hand(deviating(part)))


def _least_cost(part: PartFit) -> float:
    """What a part's nuisances can bring its cost to, to first order: their fit ends where the floor is reached."""
    fit = part.base
    rows = fit.problem.residuals(fit.point[None])[0]
    least = rows + fit.slopes @ np.linalg.lstsq(fit.slopes, -rows, rcond=None)[0]
    return float(least @ least)


@dataclass(frozen=True)
class _Begun:
    """A cause with values, and what all groups leave with it: rows (m,)."""

    cause: SharedCause
    values: dict[str, float]
    rows: np.ndarray

    @property
    def cost(self) -> float:
        return float(self.rows @ self.rows)


@dataclass(frozen=True)
class _Held:
    """A cause fitted to its end with the groups beside it, and what held-out motion says of each (see `passing`).

    `slopes` (m, q) are those of the rows of the search `there`; `helped` says whether it takes from each group.
    """

    found: _Begun
    slopes: np.ndarray
    there: SharedSearch
    looked_at: list[tuple[Reduced, PartFit]]
    squares: list[tuple[np.ndarray, np.ndarray] | None]
    helped: bool

    @property
    def passes(self) -> bool:
        return None not in self.squares


class SharedSearch:
    """Looks for one cause behind what several groups show."""

    def __init__(self, twin: TwinModel, reduction: Reduction, above: Sequence[tuple[Reduced, PartFit]]) -> None:
        self._twin, self._reduction, self._above = twin, reduction, list(above)
        self._groups = concurrently(lambda item: GroupRows(*item), self._above)
        self._nothing = np.concatenate([group.rows for group in self._groups])

    def only(self, chosen: Sequence[int]) -> SharedSearch:
        """The same search for some of its groups."""
        other = copy.copy(self)
        other._above, other._groups = [self._above[i] for i in chosen], [self._groups[i] for i in chosen]
        other._nothing = np.concatenate([group.rows for group in other._groups])
        return other

    def above(self, floors: float) -> list[int]:
        """The groups that leave more than so many floors with what their nuisances can do."""
        return np.flatnonzero(concurrently(lambda group: group.above(floors), self._groups)).tolist()

    @property
    def _most_cost(self) -> float:
        """What a cause may leave of all rows and still take its share of what is above the floor from most groups."""
        above = sorted(float(group.rows @ group.rows) - group.floor_cost for group in self._groups)
        return float(self._nothing @ self._nothing) - SHARED_TAKEN * sum(
            max(one, 0.0) for one in above[: len(above) // 2 + 1]
        )

    def _helps_most(self, begun: _Begun) -> bool:
        """Whether a cause takes its share of what is above the floor from most groups, or brings them to it."""
        ends = np.cumsum([len(group.rows) for group in self._groups])[:-1]
        helped = 0
        for group, rows in zip(self._groups, np.split(begun.rows, ends), strict=True):
            nothing, left = float(group.rows @ group.rows), float(rows @ rows)
            most = max(FLOOR_CHI_SQUARE * group.floor_cost, nothing - SHARED_TAKEN * (nothing - group.floor_cost))
            helped += left <= most
        return 2 * helped > len(self._groups)

    def _changed(self, cause: SharedCause, values: Mapping[str, float]) -> list[Reduced]:
        if cause.effect.shared != "load":
            return [
                Reduced(r.name, r.joints, r.twin.changed(cause.terms(r.twin, values)), r.train, r.holdout)
                for r, _ in self._above
            ]
        whole = self._twin.changed(cause.terms(self._twin, values))
        found = [self._reduction.anew(whole, reduced) for reduced, _ in self._above]
        return [reduced for reduced in found if reduced is not None]

    def _rows(self, cause: SharedCause, values: Mapping[str, float]) -> np.ndarray:
        """(m,) what all groups leave with a cause of these values."""
        changed = self._changed(cause, values)
        seen = [group.seen(reduced) for group, reduced in zip(self._groups, changed, strict=True)]
        return np.nan_to_num(np.concatenate(seen), nan=1e3, posinf=1e3, neginf=-1e3)

    def begun(self, cause: SharedCause) -> list[_Begun]:
        """A cause at the best of its starts for each of its forms, the best first; none where it cannot act.

        How strong a load or a delay may be follows from no scale of one place, so that shares go over decades. Forms
        differ in what no fit moves, such as how much of a friction sticks: which is the better says only its fit.
        """
        joints = [joint for reduced, _ in self._above for joint in reduced.joints]
        starts = cause.starts(self._twin, joints)
        outwards = cause.directions(starts)
        found: list[_Begun] = []
        if cause.effect.shared == "load":
            for start in outwards:
                found += self._projected(cause, start)
        else:
            begun = [(start, 1.0) for start in starts]
            begun += [(start, share) for start in outwards for share in SHARED_SHARES[1:]]
            found = [one for start, share in begun if (one := self._at(cause, start, share)) is not None]
        best: dict[tuple[float, ...], _Begun] = {}
        for one in sorted(found, key=lambda one: one.cost):
            best.setdefault(cause.form(one.values), one)
        return list(best.values())

    def at(self, cause: SharedCause, values: Mapping[str, float]) -> _Begun:
        """A cause at known values."""
        complete = cause.accepted({**values, **cause.given})
        return _Begun(cause, complete, self._rows(cause, complete))

    def estimates(self, found: _Begun, slopes: np.ndarray) -> dict[str, Estimate]:
        """A fitted cause's values with their intervals, from the slopes (m, q) of the rows."""
        samples = sum(group.floor_cost for group in self._groups)
        fitted = slopes.shape[1] + sum(len(part.variables) for _, part in self._above)
        inflated = inflation(found.cost / samples, samples, fitted)
        return found.cause.estimates(self._twin, found.values, slopes, inflated)

    def beside(self, cause: SharedCause, values: Mapping[str, float]) -> list[tuple[Reduced, PartFit]]:
        """The groups with a cause in their models, and what is uncertain about them fitted beside it."""
        changed = self._changed(cause, values)
        if cause.effect.shared == "load":
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

    def _at(self, cause: SharedCause, start: Mapping[str, float], share: float) -> _Begun | None:
        """A cause at a share of a start; None where it cannot stand beside what the twin has."""
        values = cause.along(start, share)
        with contextlib.suppress(BadInput):
            return _Begun(cause, values, self._rows(cause, values))
        return None

    def _projected(self, cause: SharedCause, start: Mapping[str, float]) -> list[_Begun]:
        """A load, whose torques grow in proportion to it, as strong as a light one says that it should be.

        What is further than the motion stays in proportion would be worse than the light one, and is halved.
        """
        light = self._at(cause, start, SHARED_SHARES[-1])
        if light is None:
            return []
        change = (light.rows - self._nothing) / SHARED_SHARES[-1]
        share = float(np.clip(-(change @ self._nothing) / max(change @ change, 1e-30), 0.0, 1.0))
        found = [light]
        for _ in range(SHARED_HALVINGS + 1):
            full = self._at(cause, start, share) if share > SHARED_SHARES[-1] else None
            if full is not None:
                found.append(full)
            if full is None or full.cost < light.cost:
                break
            share *= 0.5
        return found

    def fitted(self, begun: _Begun, reach: float = np.inf) -> tuple[_Begun, np.ndarray]:
        """(where Gauss-Newton takes a cause, (m, q) slopes there); what comes to no cost within `reach` is left.

        Friction makes slopes over a tenth of a value another thing than slopes nearby, so that each round looks nearer,
        and a step that gains nothing is halved.
        """
        cause = begun.cause
        slopes = np.empty((len(begun.rows), 0))
        for count, share in enumerate(SHARED_STEPS):
            steps = {n: share * max(abs(begun.values[n]), abs(cause.typical(n))) for n in cause.amplitudes}
            stepped = [begun.values | {name: begun.values[name] + step} for name, step in steps.items()]
            found = concurrently(lambda values: self._rows(cause, values), stepped)
            slopes = np.column_stack([(r - begun.rows) / step for r, step in zip(found, steps.values(), strict=True)])
            move = np.linalg.lstsq(slopes, -begun.rows, rcond=None)[0]
            expected = begun.cost - float(((begun.rows + slopes @ move) ** 2).sum())
            # where a cause begins its slopes may promise too little, so that it is moved once
            within = min(reach, self._most_cost) if count else reach
            if 0.5 * expected < SHARED_SETTLED_NATS or begun.cost - expected > within:
                break
            begun = self._moved(begun, move)
        return self._without_idle(begun, slopes), slopes

    def _without_idle(self, begun: _Begun, slopes: np.ndarray) -> _Begun:
        """A cause with those values back at neutral that do nothing where they are, such as a limit never reached."""
        neutral, idle = begun.cause.effect.neutral(), {}
        for name, column in zip(begun.cause.amplitudes, slopes.T, strict=True):
            if float(np.linalg.norm(column)) * abs(begun.values[name] - neutral[name]) < 1.0:
                idle[name] = neutral[name]
        without = self.at(begun.cause, begun.values | idle) if 0 < len(idle) < len(begun.cause.amplitudes) else begun
        return without if without.cost < begun.cost + 1.0 else begun

    def _moved(self, begun: _Begun, move: np.ndarray) -> _Begun:
        """A cause after a step (q,) of its values, as much of it as lowers the cost."""
        for halving in range(SHARED_HALVINGS + 1):
            both = zip(begun.cause.amplitudes, move, strict=True)
            moved = {name: begun.values[name] + float(m) * 0.5**halving for name, m in both}
            trial = self.at(begun.cause, begun.values | moved)
            if trial.cost < begun.cost:
                return trial
        return begun

    def settled(self, begun: _Begun) -> tuple[_Begun, np.ndarray, SharedSearch]:
        """As `fitted`, and once more with what nuisances can do taken where that has come to; and the search there.

        There the measured motion is smoothed by a twin that has the cause, and follows it better.
        """
        cause, found = begun.cause, self.fitted(begun)[0]
        twin = self._twin.changed(cause.terms(self._twin, found.values))
        reduction = self._reduction.following(twin)
        there = SharedSearch(twin, reduction, looked_at_again(twin, reduction, [r for r, _ in self._above], at_nominal))
        return (*there.fitted(there.at(cause, found.values)), there)

    def _held_to(self, begun: _Begun, seed: int) -> _Held:
        found, slopes, there = self.settled(begun)
        looked_at = there.beside(found.cause, found.values)
        squares = passing(self._above, looked_at, seed)
        fitted = not any(part.nominal for _, part in self._above)
        if None in squares and fitted and found.cause.effect.shared != "load":
            # the others may move more like the robot as what is uncertain about each was fitted than as the cause says
            before = self.beside(found.cause, found.values)
            other = passing(self._above, before, seed)
            if other.count(None) < squares.count(None):
                looked_at, squares = before, other
        both = zip(self._above, looked_at, strict=True) if looked_at else ()
        helped = bool(looked_at) and all(new.base.cost < old.base.cost for (_, old), (_, new) in both)
        return _Held(found, slopes, there, looked_at, squares, helped)

    def best(self, causes: Sequence[SharedCause], seed: int, *, most_left: float = np.inf) -> Shared | None:
        """The cause that brings the groups back to the floor, on held-out motion too; None where none does.

        What leaves more than a share `most_left` of the cost beside the floor is not looked at any further.
        """
        begun = [forms for forms in concurrently(lambda cause: self.begun(cause), causes) if forms]
        begun.sort(key=lambda forms: forms[0].cost)
        finalists: list[list[_Begun]] = []
        for forms in begun[:SHARED_FINALISTS]:
            least = min((forms[0].cost for forms in finalists), default=np.inf)
            fitted = [self.fitted(one, COMPARABLE * least)[0] for one in forms]
            finalists.append(sorted(fitted, key=lambda fit: fit.cost))
        if not finalists:
            return None
        fits = [forms[0] for forms in finalists]
        forms = min(finalists, key=lambda forms: forms[0].cost)
        best = forms[0]
        nothing = float(self._nothing @ self._nothing)
        if best.cost > most_left * nothing + sum(group.floor_cost for group in self._groups):
            return None
        if not self._helps_most(best):
            return None
        held = self._held_to(best, seed)
        if len(forms) > 1 and not held.passes and held.helped:
            # where joints differ in how much they have, its form shows only when each has its own share
            held = self._held_to(forms[1], seed)
        found, slopes, there = held.found, held.slopes, held.there
        cause, values = found.cause, found.values
        above, looked_at, squares = self._above, held.looked_at, held.squares
        if None in squares and cause.effect.shared == "load":
            # a load ties the joints that carry it together, more than their measured motion can say of each other
            above = self.joined(self._twin)
            looked_at = there.joined(self._twin.changed(cause.terms(self._twin, values)))
            squares = passing(above, looked_at, seed)
        elif None in squares:
            right = [i for i, one in enumerate(squares) if one is not None]
            if held.helped and 2 * len(right) > len(squares) > 2:
                # what most have all may have, and some something of their own beside it
                return self.only(right).best(causes, seed)
        if not squares or None in squares:
            return None
        before, after = (np.concatenate(both) for both in zip(*filter(None, squares), strict=True))
        others = [other for other in fits if other is not best]
        ties = tuple(o.cause.name for o in others if 0.5 * (o.cost - best.cost) < DECISIVE_NATS)
        shares = posterior({one.cause.name: 0.5 * (nothing - one.cost) for one in fits}, DECISIVE_NATS)
        both = zip(above, looked_at, strict=True)
        if any(old.nominal for _, old in above):
            # over what the uncertain values could do instead, which nobody has fitted: on what was searched
            evidence = 0.5 * (nothing - found.cost)
        else:
            evidence = 0.5 * sum(_least_cost(old) - _least_cost(new) for (_, old), (_, new) in both)
        if evidence < DECISIVE_NATS:
            return None
        joints = tuple(dict.fromkeys(joint for reduced, _ in self._above for joint in reduced.joints))
        finding = Finding(
            effect=cause.effect.key,
            target=cause.target,
            joints=joints,
            parameters=there.estimates(found, slopes),
            values=cause.term(values).values,
            moved={name: value for _, part in looked_at for name, value in part.base.moved.items()},
            evidence_nats=evidence,
            holdout_mse_before_rad2=float(before.mean()),
            holdout_mse_after_rad2=float(after.mean()),
            holdout_gain=1.0 - float(after.mean() / max(before.mean(), 1e-30)),
            holdout_gain_ci95=block_gain(before, after, max(1, len(before) // 50), seed),
            confusable_with=ties,
            probability=shares[cause.name],
            explanation=cause.effect.story.explanation,
        )
        return Shared(finding, shares, cause.terms(self._twin, values), looked_at)
