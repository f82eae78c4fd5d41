"""Which candidates are worth a fit: looked at quickly, on the motion where the model fails most."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis, hypotheses, informed
from twin_daemon.diagnosis.fit import FirstFit, Fit, Start, own_columns
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import DECISIVE_NATS, FURTHEST_ALONG, MOST_OF_EXCESS, SCREENED_S
from twin_daemon.errors import BadInput
from twin_daemon.estimation.nuisances import factors
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Derivative, descend, differenced
from twin_daemon.estimation.variables import Variable, over_some
from twin_daemon.executor import concurrently
from twin_daemon.simulation.twin import TwinModel


class _Anchor:
    """A point of the nuisances with its rows and their derivative, seen on the motion that is screened."""

    def __init__(self, point: np.ndarray, rows: np.ndarray, slopes: np.ndarray) -> None:
        self.point, self.columns = point, slopes
        self._rows = rows
        self._basis, self._weights = np.linalg.qr(slopes)
        self._kept: dict[tuple[int, ...], np.ndarray] = {}
        self.coarse = np.empty(0)

    def left(self, dropped: tuple[int, ...] = (), change: np.ndarray | None = None) -> tuple[float, float]:
        """(cost, amount): what the nuisances, but for the dropped ones, and the best amount of a change (m,) leave."""
        rows = self._without(dropped, self._rows)
        if change is None:
            return float(rows @ rows), 0.0
        seen = self._without(dropped, change)
        power = float(seen @ seen)
        if not np.isfinite(power) or power < 1e-12:
            return float("inf"), 0.0
        amount = float(np.clip(-(seen @ rows) / power, 0.0, FURTHEST_ALONG))
        rows = rows + amount * seen
        return float(rows @ rows), amount

    def _without(self, dropped: tuple[int, ...], rows: np.ndarray) -> np.ndarray:
        """(m,) rows without what the nuisances can do, but for the dropped ones.

        Within the span of all of them, so that a set which is dropped costs a small matrix and no basis of its own.
        """
        if dropped not in self._kept:
            self._kept[dropped], _ = np.linalg.qr(np.delete(self._weights, dropped, axis=1))
        kept = self._kept[dropped]
        return rows - self._basis @ (kept @ (kept.T @ (self._basis.T @ rows)))


@dataclass(frozen=True)
class AskedBefore:
    """Joints of which all candidates have been asked, and the fits of those that were right or not far behind."""

    joints: frozenset[str]
    fits: tuple[Fit, ...]

    def fit_of(self, hypothesis: Hypothesis) -> Fit | None:
        """The fit of a candidate at these joints; None where it is of others, or was far behind."""
        return next((fit for fit in self.fits if fit.hypothesis and fit.hypothesis.name == hypothesis.name), None)


class Screening:
    """A part's candidates, from several points of its nuisances."""

    def __init__(self, part: PartFit, before: AskedBefore | None = None) -> None:
        """Chooses the motion where the model fails most, and points of the nuisances from which to look at it.

        The first is where they fit best alone. There the nuisances of the joint that fails have moved to stand in for
        what is missing; so for each group of joints that one servo moves there is another point, at which its own are
        nominal again and all others stay.

        Of joints that were `before` looked at without the others only what came near is asked, from where it came to.
        """
        self._part, self._before = part, before
        rows = part.problem.residuals(part.base.point[None])[0]
        blocks = part.problem.blocks()
        costs = [float((rows[a:b] ** 2).sum()) / max(b - a, 1) for a, b in blocks]
        taken: list[int] = []
        for index in np.argsort(costs)[::-1]:
            taken.append(int(index))
            if sum(part.recordings[i].time_s[-1] for i in taken) >= SCREENED_S:
                break
        taken.sort()
        chosen = np.concatenate([*(np.arange(*blocks[i]) for i in taken), np.arange(blocks[-1][1], len(rows))])
        self._screened = [part.recordings[i] for i in taken]
        self._screened_corrections = [part.corrections[i] for i in taken]
        self._anchors: dict[frozenset[str] | None, _Anchor] = {
            None: _Anchor(part.base.point, rows[chosen], part.base.slopes[chosen])
        }
        problem = self._screened_of(part.problem)
        nominal = problem.start
        for group in part.groups:
            if group & part.suspects:
                own = [not v.joints or set(v.joints) <= group for v in part.variables]
                point = np.where(own, nominal, part.base.point)
                at = problem.residuals(point[None])[0]
                self._anchors[group] = _Anchor(point, at, differenced(problem, point, at, range(len(point))))
        coarse = self._screening_problem(part.coarse, part.variables, ())
        for anchor in self._anchors.values():
            anchor.coarse = coarse.residuals(anchor.point[None])[0]

    @property
    def cost(self) -> float:
        """What the nuisances alone reach on the motion that is screened."""
        return self.left_at(None)

    def left_at(self, anchor: frozenset[str] | None) -> float:
        """What the nuisances alone reach from one of their points, to first order."""
        return self._anchors[anchor].left()[0]

    def cost_of(self, fit: Fit) -> float:
        """What a fit of the part leaves of the motion that is screened."""
        rows = self._screened_of(fit.problem).residuals(fit.point[None])[0]
        return float(rows @ rows)

    @property
    def floor_cost(self) -> float:
        """What a right model leaves of the motion that is screened."""
        return (
            float(sum(len(r.time_s) for r in self._screened) * len(self._part.joints)) / self._part.problem.correlation
        )

    @cached_property
    def candidates(self) -> list[Hypothesis]:
        """What may act at the joints at which something may be missing."""
        part, before = self._part, self._before
        every = hypotheses(part.twin, sorted(part.suspects, key=part.joints.index), whole_hand=False)
        if before is None:
            return every
        return [h for h in every if before.fit_of(h) or not (part.group_of(h.target) or set()) & before.joints]

    def promising(self) -> bool:
        """Whether some candidate may take most of what is left beyond the floor away, by the secants to its starts."""
        screened = concurrently(self.screen, self.candidates)
        return any(self.promises(starts[0].expected) for starts in screened if starts)

    def promises(self, cost: float) -> bool:
        """Whether what leaves a cost takes most of what is left beyond the floor away."""
        gained, excess = self.cost - cost, self.cost - self.floor_cost
        return gained > max(MOST_OF_EXCESS * excess, 2.0 * DECISIVE_NATS)

    def screen(self, hypothesis: Hypothesis) -> list[Start]:
        """Starts of a candidate with the cost that it could reach along the secant to each, nuisances going along.

        A finite-size change is used because backlash or dry friction are not smooth at zero; at twice the time
        step, because a change is a difference of two roll-outs, which share its error.
        """
        before = self._before.fit_of(hypothesis) if self._before else None
        if before is not None:
            begun = hypothesis.starting((before.values, *hypothesis.starts))
            return [Start(begun, begun.starts[0], None, self.cost, before.nuisances)]
        found: list[Start] = []
        gaps = self._nominal_gaps if hypothesis.effect.reads_nominal_error else self._gaps
        hypothesis = informed(hypothesis, self._part.twin, self._part.recordings, self._part.joints, gaps)
        turned = {v.name: v.value(u) for v, u in zip(self._part.variables, self._part.base.point, strict=True)}
        freed = hypothesis.freed(self._part.twin, factors(self._part.variables, turned))
        # what a nuisance has taken away is no more seen in the error: a fit may go as far as that has gone
        suggested, hypothesis = hypothesis.starts, hypothesis.starting((*hypothesis.starts, *freed))
        spoken = hypothesis.speaks_for(self._part.twin)
        dropped = tuple(i for i, variable in enumerate(self._part.variables) if variable.name in spoken)
        own = self._part.group_of(hypothesis.target)
        groups = [group for group in (None, own) if group in self._anchors and not (dropped and group is None)]
        for values in suggested:
            with contextlib.suppress(BadInput):
                changed = self._part.coarse.changed(self._part.coarse.terms.with_effect(hypothesis.term(values)))
                problem = self._screening_problem(changed, self._part.variables, sorted(hypothesis.holds_offset()))
                for group in groups:
                    anchor = self._anchors[group]
                    change = problem.residuals(anchor.point[None])[0] - anchor.coarse
                    cost, amount = anchor.left(dropped, change)
                    if np.isfinite(cost):
                        found.append(Start(hypothesis, hypothesis.along(values, amount), group, cost))
        pull = sum(self._part.base.deviations[self._part.variables[i].name] ** 2 for i in dropped)
        for values in freed:
            found.append(Start(hypothesis, values, None, self.cost - pull))
        for joint in hypothesis.holds_offset():
            # elsewhere a small offset is free: its candidate begins where that has gone, from either point
            for anchor, gaps in ((None, self._gaps), (own, self._nominal_gaps)):
                if anchor is None or anchor in self._anchors:
                    offset = {hypothesis.effect.parameters[0].name: self._mean_residual(joint, gaps)}
                    values = hypothesis.effect.complete(hypothesis.clipped(offset))
                    # first among its starts: an offset is read off, it needs no search
                    found.append(Start(hypothesis, values, anchor, 0.0))
        return sorted(found, key=lambda start: start.expected)

    @cached_property
    def _gaps(self) -> list[np.ndarray]:
        """(n, k) rad a recording: measured minus predicted where the nuisances alone fit best."""
        return [gap[0] for gap in self._part.problem.joint_residuals(self._part.base.point[None])]

    @cached_property
    def _nominal_gaps(self) -> list[np.ndarray]:
        """(n, k) rad a recording: the same where all nuisances are nominal."""
        return [gap[0] for gap in self._part.problem.joint_residuals(self._part.problem.start[None])]

    def _mean_residual(self, joint: str, gaps: Sequence[np.ndarray]) -> float:
        """rad: what a joint reads beyond its prediction, on average over all motion."""
        column = self._part.joints.index(joint)
        known = [np.isfinite(r.measured[:, self._part.twin.joints.index(joint)]) for r in self._part.recordings]
        return float(np.concatenate([g[k, column] for g, k in zip(gaps, known, strict=True)]).mean())

    def _screening_problem(
        self, twin: TwinModel, variables: Sequence[Variable], offset_held: Sequence[str]
    ) -> Posterior:
        return Posterior(
            twin,
            self._screened,
            over_some(variables, self._part.recordings, self._screened),
            self._part.joints,
            self._part.floor,
            offset_held=offset_held,
            corrections=self._screened_corrections,
        )

    def enter(self, start: Start) -> FirstFit | None:
        """A start rolled out as it is, with the cost that it has once the nuisances have gone along, to first order.

        None where the effect cannot stand beside the twin's others.
        """
        with contextlib.suppress(BadInput):
            whole = self._part.problem_with((start.hypothesis, start.values))
            problem = self._screened_of(whole)
            anchor = self._anchors[start.anchor]
            known = {v.name: u for v, u in zip(self._part.variables, anchor.point, strict=True)}
            point = problem.start_from(known | dict(start.nuisances))
            rows = problem.residuals(point[None])[0]
            slopes = self._slopes(problem, anchor)
            free = [i for i, variable in enumerate(problem.variables) if variable.prior is not None]
            basis, _ = np.linalg.qr(slopes[:, free])
            left = rows - basis @ (basis.T @ rows)
            return FirstFit(start, whole, point, float(left @ left), rows)
        return None

    def first_fit(self, entered: FirstFit, evaluations: int, *, settled: bool = True) -> FirstFit:
        """A first fit, on the motion that is screened: derivatives by the nuisances are taken over.

        Unless it is to be `settled`, the time step's error is taken as the nominal model's.

        The time step's error is the candidate's own, where it begins and for its rank where it ends: the flanks of a
        gap are an order of magnitude stiffer than anything in the model without it.
        """
        problem, begun = self._screened_of(entered.problem), entered.rows
        usual = problem.uncertainty_cost
        if settled:
            problem, begun = problem.corrected(problem.corrections_at(entered.point)), None
        slopes = entered.slopes
        if slopes is None:
            slopes = self._slopes(problem, self._anchors[entered.start.anchor])
        derivative = Derivative(problem, own_columns(problem), slopes)
        found = descend(problem, entered.point, derivative, evaluations=evaluations, begun=begun)
        rows, uncertain = found.rows, problem.uncertainty_cost
        if settled:
            judged = problem.corrected(problem.corrections_at(found.point))
            rows, uncertain = judged.residuals(found.point[None])[0], judged.uncertainty_cost
        # as all costs here, without what the part's own roll-outs are uncertain of
        cost = float(rows @ rows) + uncertain - usual
        return FirstFit(entered.start, entered.problem, found.point, cost, rows, found.slopes)

    def _screened_of(self, whole: Posterior) -> Posterior:
        variables = over_some(whole.variables, self._part.recordings, self._screened)
        return whole.over(self._screened, variables, self._screened_corrections)

    def _slopes(self, problem: Posterior, anchor: _Anchor) -> np.ndarray:
        """The anchor's derivative, in the order of the rows and variables of a candidate's problem."""
        priors = problem.prior_slopes()
        data = len(anchor.columns) - len(self._part.variables)
        slopes = np.zeros((data + len(priors), len(problem.variables)))
        columns = {v.name: i for i, v in enumerate(self._part.variables)}
        whole = {v.name: v for v in self._part.variables}
        for index, variable in enumerate(problem.variables):
            if variable.prior is not None:
                slopes[:data, index] = anchor.columns[:data, columns[variable.name]]
                # what it no longer multiplies beside this candidate no longer moves with it
                for name in whole[variable.name].factors[1:]:
                    if name not in variable.factors and name in columns:
                        slopes[:data, index] -= anchor.columns[:data, columns[name]]
        slopes[data:] = priors
        return slopes
