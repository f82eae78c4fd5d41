"""One part of the hand under diagnosis: its nuisances fitted once, then every candidate against them."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from mujoco import minimize

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.nuisances import nuisance_knobs, sigmas
from twin_daemon.diagnosis.whitened import WhitenedProblem, floor_variance, step_corrections
from twin_daemon.errors import BadInput
from twin_daemon.fitting.knobs import Knob
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

_STEP = 3e-3  # of a knob's box, for its derivative
_NUISANCE_ITERATIONS = 15


@dataclass(frozen=True)
class Fit:
    """A fitted candidate: its point over `problem.knobs`, its cost (-2 log posterior) and its chi-square."""

    hypothesis: Hypothesis | None
    problem: WhitenedProblem
    point: np.ndarray
    cost: float
    chi_square: float

    @property
    def values(self) -> dict[str, float]:
        """The effect's parameters by name."""
        if self.hypothesis is None:
            return {}
        own = {k.name: v for k, v in zip(self.problem.knobs, self.problem.values(self.point), strict=True)}
        names = [p.name for p in self.hypothesis.effect.parameters]
        found = {name: own.get(f"{self.hypothesis.name}.{name}") for name in names}
        fixed = self.hypothesis.effect.complete({})
        return {name: float(fixed[name] if value is None else value) for name, value in found.items()}

    @property
    def nuisances(self) -> dict[str, float]:
        """Unit coordinates of the nuisances by name."""
        return {k.name: float(u) for k, u in zip(self.problem.knobs, self.point, strict=True) if k.prior is not None}


class PartFit:
    """A sub-model with its recordings: the fit of nuisances alone, and of candidates beside them."""

    def __init__(self, twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str]) -> None:
        self.twin = twin
        self.recordings = tuple(recordings)
        self.joints = tuple(joints)
        self.floor = floor_variance(recordings, joints)
        self.knobs = nuisance_knobs(twin, recordings, joints)
        self._corrections = step_corrections(twin, recordings, joints)
        self.floor = self.floor + np.mean([(0.5 * c).var(axis=0) for c in self._corrections], axis=0)
        self.problem = WhitenedProblem(twin, recordings, self.knobs, joints, self.floor, corrections=self._corrections)
        self._coarse = twin.at_step(2.0 * float(twin.model.opt.timestep))
        self.base = self._fit_nuisances()

    # -- nuisances -----------------------------------------------------------------------------------------

    def _fit_nuisances(self) -> Fit:
        fit = descended(None, self.problem, self.problem.start, _NUISANCE_ITERATIONS)
        point = fit.point
        self.base_rows = self.problem.residuals(point[None])[0]
        self.jacobian = self._derivative(point, self.base_rows)
        self._basis, _ = np.linalg.qr(self.jacobian)
        self._projected = self.base_rows - self._basis @ (self._basis.T @ self.base_rows)
        coarse = WhitenedProblem(
            self._coarse, self.recordings, self.knobs, self.joints, self.floor, corrections=self._corrections
        )
        self._coarse_rows = coarse.residuals(point[None])[0]
        return fit

    def _derivative(self, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
        sign = np.where(point > 0.5, -1.0, 1.0)
        trials = point + np.eye(len(point)) * (_STEP * sign)[:, None]
        return ((self.problem.residuals(trials) - rows) / (_STEP * sign)[:, None]).T

    def strained(self, fit: Fit) -> dict[str, float]:
        """How many sigma each nuisance is from its prior."""
        pairs = zip(fit.problem.knobs, fit.point, strict=True)
        return {k.name: sigmas(k, u) for k, u in pairs if k.prior is not None}

    # -- candidates ----------------------------------------------------------------------------------------

    def problem_with(
        self, hypothesis: Hypothesis, values: dict[str, float], *, coarse: bool = False
    ) -> WhitenedProblem:
        """The problem with one more effect, its parameters and all nuisances but the ones it speaks for."""
        dropped = hypothesis.speaks_for(self.twin)
        kept = tuple(k for k in self.knobs if k.name not in dropped)
        base = self._coarse if coarse else self.twin
        twin = base.changed(base.terms.with_effect(hypothesis.term(values)))
        return WhitenedProblem(
            twin,
            self.recordings,
            (*hypothesis.knobs(values), *kept),
            self.joints,
            self.floor,
            offset_held=hypothesis.holds_offset(),
            corrections=self._corrections,
        )

    def start_point(self, problem: WhitenedProblem) -> np.ndarray:
        """The candidate's own start, with the nuisances where they are without it."""
        known = self.base.nuisances
        own = problem.start
        return np.array([known.get(k.name, u) for k, u in zip(problem.knobs, own, strict=True)])

    def screen(self, hypothesis: Hypothesis) -> tuple[float, dict[str, float]]:
        """(gain, start): how much cost the candidate could take away along the secant to its best start.

        Both the residual and the change are seen with the nuisances projected out. A finite-size change is
        used because backlash or dry friction are not smooth at zero. At twice the time step: a change is a
        difference of two roll-outs, which share its error.
        """
        scored: list[tuple[float, dict[str, float]]] = []
        for start in hypothesis.starts:
            with contextlib.suppress(BadInput):
                problem = self.problem_with(hypothesis, start, coarse=True)
                rows = problem.residuals(self.start_point(problem)[None])[0]
                change = self._matched(problem, rows) - self._coarse_rows
                change = change - self._basis @ (self._basis.T @ change)
                power = float(change @ change)
                if power > 1e-12:
                    amount = float(np.clip(-(change @ self._projected) / power, 0.0, 1.5))
                    reduced = self._projected + amount * change
                    gain = float(self._projected @ self._projected - reduced @ reduced)
                    scored.append((gain, hypothesis.along(start, amount)))
        return max(scored, key=lambda item: item[0]) if scored else (0.0, {})

    def _matched(self, problem: WhitenedProblem, rows: np.ndarray) -> np.ndarray:
        """Rows of a problem that lacks some nuisances, in the order of the base problem's rows."""
        data = len(self.base_rows) - sum(k.prior is not None for k in self.knobs)
        out = self._coarse_rows.copy()
        out[:data] = rows[:data]
        priors = dict(zip([k.name for k in problem.knobs if k.prior is not None], rows[data:], strict=True))
        names = [k.name for k in self.knobs if k.prior is not None]
        out[data:] = [priors.get(name, 0.0) for name in names]
        return out

    def refit(self, hypothesis: Hypothesis, start: dict[str, float], iterations: int) -> Fit | None:
        """Fits the effect and the nuisances together; None where the effect cannot stand beside the twin's others.

        Starts with the nuisances where they are without the effect, or at their priors, whichever is better:
        without the right effect they may have gone far to stand in for it.
        """
        try:
            problem = self.problem_with(hypothesis, start)
            starts = np.stack([self.start_point(problem), problem.start])
            costs = (problem.residuals(starts) ** 2).sum(axis=1)
            return descended(hypothesis, problem, starts[int(np.argmin(costs))], iterations)
        except BadInput:
            return None

    def evidence(self, fit: Fit) -> float:
        """Gain over the nuisances alone in nats, after the Bayesian information criterion's price of parameters."""
        own = sum(k.prior is None for k in fit.problem.knobs)
        price = own * np.log(max(self.problem.effective_samples, 2.0))
        return 0.5 * (self.base.cost - fit.cost - price)

    def held_out(self, fit: Fit, recordings: Sequence[Aligned], corrections: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Residuals (n, k) rad of a fit on held-out recordings, with its nuisances as fitted."""
        knobs = tuple(k for k in fit.problem.knobs if not k.name.startswith("delay."))
        shift = self._delay(fit)
        moved = [r.with_onset(r.onset_s + shift) for r in recordings]
        problem = WhitenedProblem(fit.problem.twin, moved, knobs, self.joints, self.floor, corrections=corrections)
        known = {k.name: u for k, u in zip(fit.problem.knobs, fit.point, strict=True)}
        point = np.array([known[k.name] for k in knobs])
        return [rows[0] for rows in problem.joint_residuals(point[None])]

    def _delay(self, fit: Fit) -> float:
        values = fit.problem.values(fit.point)
        shifts = [v for k, v in zip(fit.problem.knobs, values, strict=True) if k.name.startswith("delay.")]
        return float(np.mean(shifts)) if shifts else 0.0


def descended(hypothesis: Hypothesis | None, problem: WhitenedProblem, start: np.ndarray, iterations: int) -> Fit:
    """A bounded Levenberg-Marquardt descent of all knobs from a point (p,)."""

    def residual(columns: np.ndarray) -> np.ndarray:
        return problem.residuals(np.clip(np.atleast_2d(columns.T), 0.0, 1.0)).T

    found, _ = minimize.least_squares(
        start,
        residual,
        bounds=[np.zeros(len(start)), np.ones(len(start))],
        eps=_STEP,
        max_iter=iterations,
        xtol=2e-4,
        verbose=minimize.Verbosity.SILENT,
    )
    point = np.clip(np.ravel(found), 0.0, 1.0)
    rows = problem.residuals(point[None])[0]
    return Fit(hypothesis, problem, point, float(rows @ rows), float(problem.chi_square(point[None])[0]))


def knob_interval(fit: Fit, knob: Knob, sigma: float) -> tuple[float, float]:
    """95 % interval of an effect's parameter from its unit sigma, with a floor of 2 % of the value."""
    index = fit.problem.knobs.index(knob)
    unit = fit.point[index]
    low, high = knob.value(max(unit - 1.96 * sigma, 0.0)), knob.value(min(unit + 1.96 * sigma, 1.0))
    value = knob.value(unit)
    least = 0.02 * abs(value)
    return min(low, value - least), max(high, value + least)


def unit_sigmas(fit: Fit) -> np.ndarray:
    """(p,) one-sigma widths of the fit's knobs in unit coordinates, by Gauss-Newton at the fitted point."""
    point = fit.point
    step = 2e-3
    sign = np.where(point > 0.5, -1.0, 1.0)
    trials = point + np.eye(len(point)) * (step * sign)[:, None]
    rows = fit.problem.residuals(np.concatenate([point[None], trials]))
    jacobian = ((rows[1:] - rows[0]) / (step * sign)[:, None]).T
    # a residual above the floor is not noise of the size assumed: the interval widens with it
    inflation = max(1.0, fit.chi_square)
    information = jacobian.T @ jacobian / inflation + 12.0 * np.eye(len(point))
    return np.sqrt(np.diag(np.linalg.inv(information)))
