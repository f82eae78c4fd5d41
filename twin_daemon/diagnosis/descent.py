"""Least squares by few roll-outs: derivatives that cost one are computed once and then kept up to date for nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.diagnosis.whitened import WhitenedProblem
from twin_daemon.errors import BadInput

STEP = 3e-3
"""Of a knob's box, for its derivative."""

_NEAR_ZERO = 0.02
_SMALLEST_RADIUS = 1e-3
_PATTERN = (0.04, 0.005)  # first and last steps of a pattern search, of a knob's own size
_LOG_STEP = 0.1  # of the box: what counts as the size of a logarithmic knob
_WORTH = 2e-4  # of the cost: a step that promises less is the last


class Derivative:
    """The Jacobian of a problem's rows along a descent.

    Columns in `refreshed` are differenced at every point; the others once (or are given), and then follow the
    residuals by Broyden's rank-one update (Broyden 1965), which costs no roll-out.
    """

    def __init__(self, problem: WhitenedProblem, refreshed: Collection[int], known: np.ndarray | None = None) -> None:
        self._problem = problem
        self._refreshed = sorted(refreshed)
        self.matrix = known
        self._at: tuple[np.ndarray, np.ndarray] | None = None

    def __call__(self, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(m, p) at a point whose rows (m,) are known."""
        if self.matrix is None:
            self.matrix = differenced(self._problem, point, rows, range(len(point)))
        else:
            if self._at is not None:
                moved, changed = point - self._at[0], rows - self._at[1]
                length = float(moved @ moved)
                if length > 1e-16:
                    self.matrix = self.matrix + np.outer(changed - self.matrix @ moved, moved) / length
            if self._refreshed:
                self.matrix = self.matrix.copy()
                self.matrix[:, self._refreshed] = differenced(self._problem, point, rows, self._refreshed)
        self._at = (point.copy(), rows.copy())
        return self.matrix


def differenced(problem: WhitenedProblem, point: np.ndarray, rows: np.ndarray, columns: Collection[int]) -> np.ndarray:
    """(m, len(columns)) by finite differences, into the box; a knob near its lower end is stepped in proportion."""
    chosen = list(columns)
    trials = np.repeat(point[None], len(chosen), axis=0)
    steps = np.array([STEP if problem.knobs[c].log else np.clip(_NEAR_ZERO * point[c], STEP / 6, STEP) for c in chosen])
    steps = np.where(point[chosen] > 0.5, -steps, steps)
    trials[np.arange(len(chosen)), chosen] += steps
    try:
        return (problem.residuals(trials) - rows).T / steps
    except BadInput:  # beside values that cannot stand together the other side is free
        trials[np.arange(len(chosen)), chosen] -= 2.0 * steps
        return (problem.residuals(np.clip(trials, 0.0, 1.0)) - rows).T / -steps


@dataclass(frozen=True)
class Descent:
    """Where a descent has come to: point (p,), rows (m,), their derivative (m, p); and the cost that it began with."""

    point: np.ndarray
    rows: np.ndarray
    slopes: np.ndarray
    began: float


def descend(
    problem: WhitenedProblem,
    start: np.ndarray,
    derivative: Derivative,
    *,
    evaluations: int,
    enough: Callable[[np.ndarray, np.ndarray], bool] | None = None,
) -> Descent:
    """A bounded descent from a point (p,); stops early where `enough(point, rows)` says so.

    Gauss-Newton in a trust region that is a box, cut to the knobs' own box, so that each step is a bounded quadratic
    problem (solved by MuJoCo's). The first steps are short: a nuisance by two sigma, an effect by its own size.
    """
    point = np.clip(start, 0.0, 1.0)
    rows = problem.residuals(point[None])[0]
    scale, radius = _scales(problem, point), 1.0
    spent, cost = 1, float(rows @ rows)
    before = cost
    slopes = derivative(point, rows)
    while spent < evaluations and radius > _SMALLEST_RADIUS and not (enough and enough(point, rows)):
        step, expected = _step(slopes * scale, rows, (-point / scale, (1.0 - point) / scale), radius)
        trial = np.clip(point + scale * step, 0.0, 1.0)
        spent += 1
        try:
            trial_rows = problem.residuals(trial[None])[0]
        except BadInput:  # values that cannot stand together, such as a friction below none
            radius *= 0.3
            continue
        gained = cost - float(trial_rows @ trial_rows)
        if gained < 0.25 * expected:
            radius = 0.3 * min(radius, float(np.abs(step).max(initial=0.0)))
        elif gained > 0.75 * expected:
            radius = 2.0 * radius
        small = expected < _WORTH * cost
        if gained > 0.0:
            point, rows, cost = trial, trial_rows, cost - gained
            if not small:
                slopes = derivative(point, rows)
        if small:
            break
    return Descent(point, rows, slopes, before)


def searched(problem: WhitenedProblem, found: Descent, own: Collection[int]) -> Descent:
    """From where a descent has stopped, a pattern search over a few of the knobs, the others along their derivative.

    Dry friction and gaps make a cost with many small corners, at which derivatives end a descent. Steps that shrink
    from 4 % of each knob to 0.5 % get across them (Hooke and Jeeves 1961).
    """
    point, rows, slopes = found.point, found.rows, found.slopes
    others = [i for i in range(len(point)) if i not in set(own)]
    basis, _ = np.linalg.qr(slopes[:, others])
    share = _PATTERN[0]
    while share >= _PATTERN[1]:
        steps = [share * (_LOG_STEP if problem.knobs[i].log else max(point[i], _NEAR_ZERO)) for i in own]
        trials = np.repeat(point[None], 2 * len(steps), axis=0)
        for row, (index, step) in enumerate(zip(own, steps, strict=True)):
            trials[2 * row : 2 * row + 2, index] += (step, -step)
        trials = np.clip(trials, 0.0, 1.0)
        tried = problem.residuals(trials)
        # what the other knobs could take away of each counts before they have moved
        left = (tried**2).sum(axis=1) - ((tried @ basis) ** 2).sum(axis=1)
        best = int(np.argmin(np.nan_to_num(left, nan=np.inf)))
        moved = one_step(problem, trials[best], tried[best], slopes, others)
        moved_rows = problem.residuals(moved[None])[0]
        if moved_rows @ moved_rows < rows @ rows:
            point, rows = moved, moved_rows
        else:
            share /= 2.0
    return Descent(point, rows, slopes, found.began)


def one_step(
    problem: WhitenedProblem, point: np.ndarray, rows: np.ndarray, slopes: np.ndarray, columns: Collection[int]
) -> np.ndarray:
    """(p,) where the first step of a descent over some of the knobs would go."""
    chosen = list(columns)
    scale = _scales(problem, point)[chosen]
    step, _ = _step(slopes[:, chosen] * scale, rows, (-point[chosen] / scale, (1.0 - point[chosen]) / scale), 1.0)
    moved = point.copy()
    moved[chosen] = np.clip(point[chosen] + scale * step, 0.0, 1.0)
    return moved


def _step(
    slopes: np.ndarray, rows: np.ndarray, room: tuple[np.ndarray, np.ndarray], radius: float
) -> tuple[np.ndarray, float]:
    """((p,) step in units of the scales, the cost that it should take away) within a box and the trust region."""
    count = slopes.shape[1]
    hessian, gradient = slopes.T @ slopes, slopes.T @ rows
    hessian = hessian + 1e-9 * max(float(np.trace(hessian)), 1.0) * np.eye(count)
    step, scratch = np.zeros((count, 1)), np.zeros((count, count + 7))
    lower = np.maximum(room[0], -radius)[:, None]
    upper = np.minimum(room[1], radius)[:, None]
    mujoco.mju_boxQP(step, scratch, None, hessian, gradient[:, None], lower, upper)
    moved = step[:, 0]
    return moved, float(-2.0 * gradient @ moved - moved @ hessian @ moved)


def _scales(problem: WhitenedProblem, start: np.ndarray) -> np.ndarray:
    """How far each knob goes in a first step: a nuisance by about two sigma, an effect by about its own size."""
    scales = []
    for knob, unit in zip(problem.knobs, start, strict=True):
        if knob.prior is not None:
            scales.append(2.0 * knob.prior.sigma / (knob.high - knob.low))
        else:
            scales.append(0.1 if knob.log else max(unit, _NEAR_ZERO))
    return np.array(scales)
