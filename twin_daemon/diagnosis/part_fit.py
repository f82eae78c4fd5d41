"""One part of a hand under diagnosis: nuisances fitted alone, candidates screened and fitted beside them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.fit import FirstFit, Fit, as_fit, moved_parameters, own_columns
from twin_daemon.diagnosis.full_fit import fitted_to_the_end
from twin_daemon.diagnosis.in_turn import by_motion, fitted_too
from twin_daemon.diagnosis.thresholds import (
    ADEQUATE_FLOORS,
    ASTRAY_FLOORS,
    CLOSER_LOOK,
    COARSER_STEPS,
    DECISIVE_NATS,
    DELAY_ROUNDS,
    DEVIATING_SIGMA,
    ELSEWHERE_STEPS,
    FORBIDDEN_SIGMA,
    HARDLY_FURTHER,
    LEAST_SHARE_OF_ERROR,
    MOST_OF_EXCESS,
    NUISANCE_ROLLOUTS,
    SETTLED,
    STEP_ERROR_ROUNDS,
    SURE_FLOOR_SIGMA,
    SUSPECT_SIGMA,
)
from twin_daemon.diagnosis.verdict import MovedParameter
from twin_daemon.estimation.floor import floor_variance
from twin_daemon.estimation.nuisances import beside, between_sessions, carried_over, nuisance_variables
from twin_daemon.estimation.posterior import Correction, Posterior, floor_and_corrections, tolerated
from twin_daemon.estimation.solvers.trust_region import Derivative, Descent, descend, differenced
from twin_daemon.estimation.thresholds import FLOOR_CHI_SQUARE
from twin_daemon.estimation.uncertainty import conditional_information, elsewhere
from twin_daemon.estimation.variables import EffectVariable, OnsetVariable
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


class PartFit:
    """A sub-model with its recordings: the fit of nuisances alone, and of candidates beside them."""

    def __init__(
        self,
        twin: TwinModel,
        recordings: Sequence[Aligned],
        joints: Sequence[str],
        *,
        after: Fit | None = None,
        found: Sequence[Fit] = (),
        thoroughly: bool = False,
        nominal: bool = False,
        begun: PartFit | None = None,
    ) -> None:
        """With `thoroughly` the nuisances are fitted to the end, not only until they leave no more than the floor.

        With `nominal` they are not fitted at all. `begun` is the same part so far, of which the floor may be known.

        `found` are the fits of effects that the twin now has, and `after` the last: nuisances begin where it is.

        The values of these effects are uncertain as long as something else is missing, and go along as nuisances.
        """
        self.twin = twin
        self.recordings = tuple(recordings)
        self.joints = tuple(joints)
        values = [value for fit in found for value in fit.uncertain_values()]
        self.variables = (*nuisance_variables(twin, recordings, joints), *values)
        if after is not None:
            self._measured_by(after.problem.floor, after.problem.corrections)
        elif begun is not None and not begun.plainly_sound:
            self._measured_by(begun.floor, begun.corrections)
        elif nominal:
            self._measured_by(tolerated(twin, floor_variance(recordings, joints)), [])
        else:
            self._measured_by(*floor_and_corrections(twin, recordings, self.variables, joints))
        # as it is at the floor of its sensors alone: the time step's error need not be known
        self.plainly_sound = nominal and self._is_within_floor(self.problem.start, self._rows_at_start())
        if nominal and not self.plainly_sound:
            self._measured_by(*floor_and_corrections(twin, recordings, self.variables, joints))
        self._enough = None if thoroughly else self._is_within_floor
        self.coarse = twin.at_step(COARSER_STEPS * float(twin.model.opt.timestep))
        self.nominal = nominal
        self.base = self._nominal() if nominal else self._fit_nuisances(after)

    # -- nuisances -----------------------------------------------------------------------------------------

    def _measured_by(self, floor: np.ndarray, corrections: Sequence[Correction]) -> None:
        """The problem of the nuisances with a floor (k,) rad^2 and what roll-outs get wrong."""
        self.floor, self.corrections = floor, corrections
        self.problem = Posterior(
            self.twin,
            self.recordings,
            self.variables,
            self.joints,
            floor,
            corrections=corrections,
        )

    def _rows_at_start(self) -> np.ndarray:
        return self.problem.residuals(self.problem.start[None])[0]

    def _nominal(self) -> Fit:
        """All nuisances at their nominal values."""
        start, rows = self.problem.start, self._rows_at_start()
        return as_fit(None, self.problem, Descent(start, rows, np.zeros((len(rows), len(start))), np.inf))

    def _fit_nuisances(self, after: Fit | None) -> Fit:
        """From where they were beside the last effect; where that ends badly, from nominal values as well."""
        problem = self.problem
        if after is None:
            found = self._where_the_step_errs(self._settled(problem.start, None))
            problem = self.problem
            if not self._is_within_floor(found.point, found.rows):
                found = self._put_back(self._along_delays(found))
                problem = self.problem
            return as_fit(None, problem, self._no_further_than_needed(found))
        found = self._settled(problem.start_from(after.nuisances), self._taken_over(after))
        if not self._is_within_floor(found.point, found.rows):
            again = self._settled(problem.start, None)
            found = min(found, again, key=lambda one: float(one.rows @ one.rows))
        return as_fit(None, problem, found)

    def _where_the_step_errs(self, found: Descent, most: float = ADEQUATE_FLOORS) -> Descent:
        """The nuisances settled with the time step's error as it is where they have come to.

        Joints that stick go through hollows as deep as that error: it may be another one after each step. Where more
        than `most` floors are left, it is not what keeps the nuisances from it.
        """
        for again in range(STEP_ERROR_ROUNDS):
            if self._enough and self._enough(found.point, found.rows):
                break
            if again and (self.problem.times_floor(found.point) > most).any():
                break
            cost = float(found.rows @ found.rows)
            self.corrections = self.problem.corrections_at(found.point)
            self.problem = self.problem.corrected(self.corrections)
            rows = self.problem.residuals(found.point[None])[0]
            if again and abs(float(rows @ rows) - cost) < (1.0 - SETTLED) * cost:
                return replace(found, rows=rows)
            found = self._settled(found.point, found.slopes)
        return found

    def _along_delays(self, found: Descent) -> Descent:
        """The nuisances descended from other delays as well, with what makes up for these gone along.

        A later command looks like more inertia. Along that valley sticking and slipping joints have many small hollows,
        two steps apart: a descent ends in the next. Where far more than a floor is left something else is missing, and
        a delay that stands in for that is no better known.
        """
        problem = self.problem
        if (problem.times_floor(found.point) > ADEQUATE_FLOORS).any():
            return found
        onsets = [i for i, v in enumerate(problem.variables) if isinstance(v, OnsetVariable) and v.prior is not None]
        others = [i for i in range(len(found.point)) if i not in onsets]
        if not onsets or not others:
            return found
        sigma = np.array([v.prior.sigma / (v.high - v.low) for v in problem.variables if v.prior is not None])[onsets]
        for _ in range(DELAY_ROUNDS):
            points = []
            for share in (way * size for size in (0.125, 0.25, 0.375, 0.5, 0.75, 1.0) for way in (-1.0, 1.0)):
                point = found.point.copy()
                point[onsets] += share * sigma
                rows = found.rows + found.slopes[:, onsets] @ (share * sigma)
                point[others] -= np.linalg.lstsq(found.slopes[:, others], rows, rcond=None)[0]
                points.append(np.clip(point, 0.0, 1.0))
            costs = (problem.residuals(np.array(points)) ** 2).sum(axis=1)
            other = self._settled(points[int(np.argmin(costs))], found.slopes)
            if other.rows @ other.rows > found.rows @ found.rows - 2.0 * DECISIVE_NATS:
                break
            found = other
        return found

    def _put_back(self, found: Descent) -> Descent:
        """The nuisances settled once more with one that is too far off where it began, if that ends better.

        On the way from nominal values one may go far for another that has not come as far yet, and roll-outs that are
        rough, such as those of a servo at its limit, keep it there. Where much more than a floor is left something else
        is missing.
        """
        while (self.problem.times_floor(found.point) <= ASTRAY_FLOORS).all():
            known = self.problem, found, self._cost_of(found)
            off = np.flatnonzero(np.abs(self.problem.prior_residuals(found.point[None])[0]) > DEVIATING_SIGMA)
            ends = []
            for index in off:
                point = found.point.copy()
                point[index] = self.problem.start[index]
                self.problem = known[0].corrected(known[0].corrections_at(point))
                end = self._where_the_step_errs(self._settled(point, None), ASTRAY_FLOORS)
                ends.append((self.problem, end, self._cost_of(end)))
            best = min(ends, key=lambda end: end[2], default=known)
            better = best[2] < known[2] - 2.0 * DECISIVE_NATS
            self.problem, found, _ = best if better else known
            self.corrections = self.problem.corrections
            if not better:
                break
        return found

    def _cost_of(self, found: Descent) -> float:
        return float(found.rows @ found.rows) + self.problem.uncertainty_cost

    def _no_further_than_needed(self, found: Descent) -> Descent:
        """The same fit within a nat with no nuisance further off than one may be, where they are hardly further.

        A descent ends where little is left to gain, not at the last tenth of a sigma.
        """
        problem = self.problem
        off = np.abs(problem.prior_residuals(found.point[None])[0])
        if not DEVIATING_SIGMA < off.max(initial=0.0) < HARDLY_FURTHER * DEVIATING_SIGMA:
            return found
        point = np.clip(found.point, *self._plausible_box(found.point))
        rows = problem.residuals(point[None])[0]
        return found if rows @ rows > found.rows @ found.rows + 2.0 else replace(found, point=point, rows=rows)

    def _plausible_box(self, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """((p,), (p,)) about a point (p,): coordinates at which no nuisance is further off than one may be."""
        sigmas = self.problem.prior_residuals(point[None])[0]
        own = np.flatnonzero([variable.prior is not None for variable in self.problem.variables])
        steps = np.abs(np.diag(self.problem.prior_slopes()[:, own]))
        low, high = np.zeros(len(point)), np.ones(len(point))
        room = np.where(steps == 0.0, np.inf, steps)
        low[own] = np.clip(point[own] - (0.99 * DEVIATING_SIGMA + sigmas) / room, 0.0, 1.0)
        high[own] = np.clip(point[own] + (0.99 * DEVIATING_SIGMA - sigmas) / room, 0.0, 1.0)
        return low, high

    @cached_property
    def times_plausible_floor(self) -> np.ndarray:
        """(k,) what is left of each joint, in floors, at the best point at which no nuisance is too far off."""
        box, slopes = self._plausible_box(self.base.point), Derivative(self.problem, (), self.base.slopes)
        held = descend(self.problem, self.base.point, slopes, evaluations=NUISANCE_ROLLOUTS, box=box)
        return self.problem.times_floor(held.point)

    def _settled(self, point: np.ndarray, slopes: np.ndarray | None) -> Descent:
        """The nuisances alone descended from a point (p,), with new derivatives until a round gains little.

        Slopes (m, p) that are known from nearby are those of the first round.
        """
        for known in (slopes, None, None, None):
            derivative = Derivative(self.problem, (), known)
            found = descend(self.problem, point, derivative, evaluations=NUISANCE_ROLLOUTS, enough=self._enough)
            point = found.point
            if (self._enough and self._enough(point, found.rows)) or found.rows @ found.rows > SETTLED * found.began:
                break
        return found

    def _taken_over(self, fit: Fit) -> np.ndarray | None:
        """A fit's derivative by the nuisances; None where it did not have them all."""
        columns = {v.name: i for i, v in enumerate(fit.problem.variables)}
        if not all(v.name in columns for v in self.variables):
            return None
        data = self.problem.blocks()[-1][1]
        slopes = fit.slopes[:data, [columns[v.name] for v in self.variables]]
        return np.concatenate([slopes, self.problem.prior_slopes()])

    def _is_within_floor(self, point: np.ndarray, rows: np.ndarray) -> bool:
        """Whether nuisances that are nowhere near their limits leave no more than a right model does."""
        priors = rows[len(rows) - len(self.variables) :]
        data = float((rows**2).sum() - (priors**2).sum()) / self.problem.effective_samples
        if data > CLOSER_LOOK or float(np.abs(priors).max(initial=0.0)) > SURE_FLOOR_SIGMA:
            return False
        offset = max(map(abs, self.problem.offsets(point).values()), default=0.0)
        return offset < SURE_FLOOR_SIGMA and bool((self.problem.times_floor(point) <= CLOSER_LOOK).all())

    # -- candidates ----------------------------------------------------------------------------------------

    @property
    def groups(self) -> list[frozenset[str]]:
        """The part's joints by what moves them: the joints of one servo together, others alone."""
        driven = map(frozenset, self.twin.driven)
        found = [group for group in driven if group & set(self.joints)]
        return found + [frozenset({j}) for j in self.joints if not any(j in group for group in found)]

    def group_of(self, target: str) -> frozenset[str] | None:
        """The joints that an effect at a joint or a command is about; None for the whole hand."""
        for actuator, driven in zip(self.twin.actuators, self.twin.driven, strict=True):
            if target == actuator or target in driven:
                return frozenset(driven)
        return frozenset({target}) if target in self.twin.joints else None

    @cached_property
    def times_floor(self) -> np.ndarray:
        """(k,) what the nuisances alone leave of each joint, in floors."""
        return self.problem.times_floor(self.base.point)

    @property
    def within_floor(self) -> bool:
        """Whether the nuisances alone leave of every joint what its sensor does."""
        return bool((self.times_floor <= FLOOR_CHI_SQUARE).all())

    @property
    def worth_a_look(self) -> bool:
        """Whether a joint leaves more than right models do, although no more than one may."""
        return bool((self.times_floor > CLOSER_LOOK).any())

    def takes_enough(self, fit: Fit) -> bool:
        """Whether a fit takes most of what the worst joint leaves beyond its floor: asked where that is not much."""
        worst = int(np.argmax(self.times_floor))
        left = float(fit.problem.times_floor(fit.point)[worst])
        return left - 1.0 <= (1.0 - MOST_OF_EXCESS) * (float(self.times_floor[worst]) - 1.0)

    @cached_property
    def moved(self) -> tuple[MovedParameter, ...]:
        """The nominal parameters that are elsewhere than the model says, by the nuisances alone."""
        return moved_parameters(self.base)

    @cached_property
    def suspects(self) -> set[str]:
        """Joints at which something may be missing: those above the floor, and those whose nuisances deviate.

        Where much is left, only what deviations beyond any plausible hand counts: nuisances go far to stand in for what
        is missing next to them.
        """
        above = (self.times_floor > FLOOR_CHI_SQUARE) & (
            self.times_floor > LEAST_SHARE_OF_ERROR * self.times_floor.sum()
        )
        found = {joint for joint, is_above in zip(self.joints, above, strict=True) if is_above}
        least, deviations = FORBIDDEN_SIGMA if found else SUSPECT_SIGMA, self.base.deviations
        found |= {joint for v in self.variables if abs(deviations[v.name]) > least for joint in v.joints}
        found |= {joint for joint in self.joints if abs(deviations.get(f"{joint}.offset", 0.0)) > least}
        for group in self.groups:
            found |= group if group & found else set()
        return (found & set(self.joints)) or set(self.joints)

    def _along(self, hypothesis: Hypothesis, variable: EffectVariable, spoken: set[str]) -> EffectVariable:
        """A candidate's variable that takes along what the nuisance did that it speaks for, such as a servo's gain.

        But for what another candidate speaks for (`spoken`).
        """
        own = hypothesis.speaks_for(self.twin)
        along = [name for v in self.variables if v.name in own for name in v.factors[1:] if name not in spoken]
        return replace(variable, along=tuple(along))

    def problem_with(self, *effects: tuple[Hypothesis, Mapping[str, float]], held: Collection[str] = ()) -> Posterior:
        """The problem with more effects, their parameters and all nuisances but the ones that they speak for.

        The effects' parameters that are `held` stay as they are given.
        """
        spoken = {name for hypothesis, _ in effects for name in hypothesis.speaks_for(self.twin)}
        offsets = {joint for hypothesis, _ in effects for joint in hypothesis.holds_offset()}
        terms, own = self.twin.terms, []
        for hypothesis, values in effects:
            terms = terms.with_effect(hypothesis.term(values))
            first, *others = hypothesis.variables(values)
            both = (self._along(hypothesis, first, spoken), *others)
            own += [variable for variable in both if variable.parameter not in held]
        return Posterior(
            self.twin.changed(terms),
            self.recordings,
            (*own, *beside(self.variables, spoken)),
            self.joints,
            self.floor,
            offset_held=sorted(offsets),
            corrections=self.corrections,
        )

    def full_fit(self, first: FirstFit, evaluations: int) -> Fit:
        """The fit on all motion of what was begun on some of it."""
        return self.ended(first.hypothesis, first.problem, first.point, evaluations)

    def ended(self, hypothesis: Hypothesis, problem: Posterior, point: np.ndarray, evaluations: int) -> Fit:
        """As `full_fit`, of a problem of this part from a point (p,)."""
        return as_fit(hypothesis, *fitted_to_the_end(hypothesis, problem, point, evaluations))

    def full_fit_together(self, fits: Sequence[Fit], evaluations: int, asked: Fit) -> list[Fit]:
        """Several effects fitted at once, to the same end as one is.

        With the nuisances from where they are beside one of them and from nominal values: the better counts.
        """
        pairs = [(fit.hypothesis, fit.values) for fit in fits if fit.hypothesis is not None]
        assert asked.hypothesis is not None
        problem = self.problem_with(*pairs)
        ends = [
            fitted_to_the_end(asked.hypothesis, problem, problem.start_from(known), evaluations)
            for known in (asked.nuisances, {})
        ]
        problem, found = min(ends, key=lambda end: float(end[1].rows @ end[1].rows))
        return [as_fit(hypothesis, problem, found) for hypothesis, _ in pairs]

    def together(self, fits: Sequence[Fit], evaluations: int) -> list[Fit]:
        """Several effects that were found one after another, fitted at once; the same fit seen from each of them."""
        pairs = [(fit.hypothesis, fit.values) for fit in fits if fit.hypothesis is not None]
        problem = self.problem_with(*pairs).corrected(fits[-1].problem.corrections)
        point = problem.start_from(fits[-1].nuisances)
        found = descend(problem, point, Derivative(problem, own_columns(problem)), evaluations=evaluations)
        return [as_fit(hypothesis, problem, found) for hypothesis, _ in pairs]

    def evidence_nats(self, fit: Fit) -> float:
        """Gain over the nuisances alone in nats, after the Bayesian information criterion's price of parameters."""
        return 0.5 * (self.base.cost - fit.cost) - self.price_of(fit)

    def price(self, problem: Posterior) -> float:
        """Nats that a problem's parameters without a prior cost, by the Bayesian information criterion."""
        own = sum(v.prior is None for v in problem.variables)
        return 0.5 * own * float(np.log(max(self.problem.effective_samples, 2.0)))

    def price_of(self, fit: Fit) -> float:
        """Nats that a fit's parameters cost; no more than the one that a nominal value has stood in for, with its gain.

        A servo's gain that is far off is one number, whatever else its law could say of the servo.
        """
        whole = self.price(fit.problem)
        spoken = fit.hypothesis.speaks_for(self.twin) if fit.hypothesis else set()
        pull = sum(sigma**2 for name, sigma in self.base.deviations.items() if name in spoken)
        if not spoken or not self.within_floor:
            return whole
        one = 0.5 * float(np.log(max(self.problem.effective_samples, 2.0)))
        return min(whole, one + max(0.5 * (self.base.cost - pull - fit.cost), 0.0))

    def held_out(self, fit: Fit, recordings: Sequence[Aligned], *, adjusted: bool = False) -> list[np.ndarray]:
        """Residuals (n, k) rad of a fit on held-out recordings, with its nuisances as fitted, without a step's error.

        With `adjusted` its values move as far as the fitted motion leaves them uncertain: what that has not determined,
        other motion may still say without the law being wrong, and another session may have a little more or less of
        each. One Gauss-Newton step, in another session a few, with the fit's posterior as prior, widened by what
        sessions differ in.
        A recording that is fitted as well is predicted by what the others say of it.
        """
        in_turn = fitted_too(self.recordings, recordings)
        if not in_turn:
            return self._held_out(fit, recordings, adjusted=adjusted)
        found: list[np.ndarray | None] = [None] * len(recordings)
        for motion, members in by_motion(recordings).items():
            seen = fit.by_others[motion] if motion in in_turn else fit
            judged = self._held_out(seen, [recordings[i] for i in members], adjusted=adjusted)
            for index, rows in zip(members, judged, strict=True):
                found[index] = rows
        return [rows for rows in found if rows is not None]

    def _held_out(self, fit: Fit, recordings: Sequence[Aligned], *, adjusted: bool) -> list[np.ndarray]:
        every = fit.problem.variables
        kept, moved = carried_over(every, fit.point, recordings)
        variables, point = tuple(every[i] for i in kept), fit.point[kept]
        if adjusted and kept:
            problem = Posterior(fit.problem.twin, moved, variables, self.joints, self.floor)
            known = conditional_information(fit.slopes, kept) / max(1.0, fit.chi_square)
            apart = between_sessions(fit.problem.twin, variables)
            steps = ELSEWHERE_STEPS if apart.any() else 1
            point = _adjusted(problem, point, elsewhere(known, apart), steps)
        problem = Posterior(fit.problem.twin, moved, variables, self.joints, self.floor)
        if not (self.plainly_sound and (problem.times_floor(point) <= CLOSER_LOOK).all()):
            problem = problem.corrected(problem.corrections_at(point))
        return [rows[0] for rows in problem.joint_residuals(point[None])]


def _adjusted(problem: Posterior, known: np.ndarray, information: np.ndarray, steps: int) -> np.ndarray:
    """(p,) a known point after some steps on a problem, held back by what is known of it: its information (p, p)."""
    problem = problem.corrected(problem.corrections_at(known))
    data = -len(problem.prior_slopes()) or None  # the priors are in what is known already
    point, every = known, problem.residuals(known[None])[0]
    for _ in range(steps):
        slopes, rows = differenced(problem, point, every, range(len(point)))[:data], every[:data]
        pull = information @ (known - point)
        step = np.linalg.lstsq(slopes.T @ slopes + information, pull - slopes.T @ rows, rcond=None)[0]
        moved = np.clip(point + step, 0.0, 1.0)
        found = problem.residuals(moved[None])[0]
        if found[:data] @ found[:data] >= rows @ rows:
            break
        point, every = moved, found
    return point
