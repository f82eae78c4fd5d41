"""Least squares by few roll-outs: derivatives that cost one are computed once and then kept up to date for nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.estimation.thresholds import (
    GOOD_AGREEMENT,
    LEAST_AGREEMENT,
    LEAST_ROOM,
    LOG_SIZE,
    NEAR_ZERO,
    PATTERN_FIRST,
    PATTERN_LAST,
    SHRINK,
    SMALLEST_RADIUS,
    TOO_STEEP,
    TRUST_STEP,
    WIDER_STEPS,
    WORTH,
)
from twin_daemon.estimation.variables import Variable


class Rows(Protocol):
    """What a descent goes down: the sum of squares of rows, over variables in the unit box."""

    @property
    def variables(self) -> Sequence[Variable]: ...

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) rows of points (B, p)."""
        ...


class Derivative:
    """The Jacobian of a problem's rows along a descent.

    Columns in `refreshed` are differenced at every point; the others once (or are given), and then follow the
    residuals by Broyden's rank-one update (Broyden 1965), which costs no roll-out.

    With `across` their steps are as wide as it takes to see past what is rough: a brake whose shoe lifts off moves a
    little otherwise for any change, and a short step takes that for a steep slope.
    """

    def __init__(
        self, problem: Rows, refreshed: Collection[int], known: np.ndarray | None = None, *, across: bool = False
    ) -> None:
        self._problem = problem
        self._refreshed = sorted(refreshed)
        self._across = across
        self._wider: np.ndarray | None = None  # times the usual step, by column that is refreshed
        self.matrix = known
        self._at: tuple[np.ndarray, np.ndarray] | None = None

    def of(self, problem: Rows) -> Derivative:
        """The same of a problem whose rows differ by what hardly hangs on the point, going on from what is known."""
        other = Derivative(problem, self._refreshed, self.matrix, across=self._across)
        other._wider = self._wider
        return other

    def __call__(self, point: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """(m, p) at a point whose rows (m,) are known."""
        if self._at is not None and self.matrix is not None and np.array_equal(point, self._at[0]):
            return self.matrix
        if self.matrix is None:
            self.matrix = differenced(self._problem, point, rows, range(len(point)))
            if self._across and self._refreshed:
                usual = self.matrix[:, self._refreshed]
                seen, self._wider = _seen_across(self._problem, point, rows, self._refreshed, usual)
                self.matrix[:, self._refreshed] = seen
        else:
            if self._at is not None:
                moved, changed = point - self._at[0], rows - self._at[1]
                length = float(moved @ moved)
                if length > 1e-16:
                    self.matrix = self.matrix + np.outer(changed - self.matrix @ moved, moved) / length
            if self._refreshed:
                self.matrix = self.matrix.copy()
                self.matrix[:, self._refreshed] = differenced(self._problem, point, rows, self._refreshed, self._wider)
        self._at = (point.copy(), rows.copy())
        return self.matrix


def differenced(
    problem: Rows, point: np.ndarray, rows: np.ndarray, columns: Collection[int], wider: np.ndarray | None = None
) -> np.ndarray:
    """(m, len(columns)) by finite differences, into the box; a variable near its lower end is stepped in proportion.

    The steps are so many times `wider` (len(columns),).
    """
    steps = np.array([_difference(problem.variables[c].log, point[c]) for c in columns])
    return stepped(problem, point, rows, columns, steps if wider is None else steps * wider)


def stepped(
    problem: Rows, point: np.ndarray, rows: np.ndarray, columns: Collection[int], steps: np.ndarray
) -> np.ndarray:
    """(m, len(columns)) by steps (len(columns),) of the unit coordinates, each towards the middle of its range."""
    chosen = list(columns)
    trials = np.repeat(point[None], len(chosen), axis=0)
    steps = np.where(point[chosen] > 0.5, -steps, steps)
    trials[np.arange(len(chosen)), chosen] += steps
    try:
        return (problem.residuals(trials) - rows).T / steps
    except BadInput:  # beside values that cannot stand together the other side is free
        trials[np.arange(len(chosen)), chosen] -= 2.0 * steps
        return (problem.residuals(np.clip(trials, 0.0, 1.0)) - rows).T / -steps


def _seen_across(
    problem: Rows, point: np.ndarray, rows: np.ndarray, columns: Collection[int], usual: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """((m, k) by steps from which on a wider one finds the slope no less steep, (k,) times the usual step).

    `usual` (m, k) is by the usual step, the first of them.
    """
    count = len(columns)
    wider_ones = (differenced(problem, point, rows, columns, np.full(count, wider)) for wider in WIDER_STEPS[1:])
    tried = [usual, *wider_ones]
    sizes = [np.linalg.norm(matrix, axis=0) for matrix in tried]
    matrix, found = tried[-1].copy(), np.full(count, float(WIDER_STEPS[-1]))
    smooth = np.ones(count, bool)  # from there on
    for wider, steep, size, beyond in zip(WIDER_STEPS[-2::-1], tried[-2::-1], sizes[-2::-1], sizes[:0:-1], strict=True):
        smooth &= size <= TOO_STEEP * beyond
        matrix[:, smooth], found[smooth] = steep[:, smooth], float(wider)
    return matrix, found


def _difference(log: bool, unit: float) -> float:
    """The step of a finite difference at a unit coordinate."""
    return float(TRUST_STEP if log else np.clip(NEAR_ZERO * unit, TRUST_STEP / 6, TRUST_STEP))


@dataclass(frozen=True)
class Descent:
    """Where a descent has come to: point (p,), rows (m,), their derivative (m, p); and the cost that it began with.

    `spent` are the points that it has tried, those of derivatives not among them.
    """

    point: np.ndarray
    rows: np.ndarray
    slopes: np.ndarray
    began: float
    spent: int = 0


def descend(
    problem: Rows,
    start: np.ndarray,
    derivative: Derivative,
    *,
    evaluations: int,
    enough: Callable[[np.ndarray, np.ndarray], bool] | None = None,
    begun: np.ndarray | None = None,
    box: tuple[np.ndarray, np.ndarray] | None = None,
) -> Descent:
    """A bounded descent from a point (p,); stops early where `enough(point, rows)` says so.

    Where the rows (m,) at the start are known, as `begun`, they are not rolled out again. `box` ((p,), (p,)) are the
    lowest and highest coordinates where these are not 0 and 1.

    Gauss-Newton in a trust region that is a box, cut to the variables' bounds, so that each step is a bounded quadratic
    problem (solved by MuJoCo's). The first steps are short: a nuisance by two sigma, an effect by its own size.
    """
    low, high = (np.zeros(len(start)), np.ones(len(start))) if box is None else box
    point = np.clip(start, low, high)
    rows, spent = (problem.residuals(point[None])[0], 1) if begun is None else (begun, 0)
    scale, radius = _scales(problem, point), 1.0
    cost = float(rows @ rows)
    before = cost
    slopes = derivative(point, rows)
    while spent < evaluations and radius > SMALLEST_RADIUS and not (enough and enough(point, rows)):
        step, expected = bounded_step(slopes * scale, rows, ((low - point) / scale, (high - point) / scale), radius)
        trial = np.clip(point + scale * step, low, high)
        spent += 1
        try:
            trial_rows = problem.residuals(trial[None])[0]
        except BadInput:  # values that cannot stand together, such as a friction below none
            radius *= SHRINK
            continue
        gained = cost - float(trial_rows @ trial_rows)
        if gained < LEAST_AGREEMENT * expected:
            radius = SHRINK * min(radius, float(np.abs(step).max(initial=0.0)))
        elif gained > GOOD_AGREEMENT * expected:
            radius = 2.0 * radius
        small = expected < WORTH * cost
        if gained > 0.0:
            point, rows, cost = trial, trial_rows, cost - gained
            if not small:
                slopes = derivative(point, rows)
        if small:
            break
    return Descent(point, rows, slopes, before, spent)


def searched(problem: Rows, found: Descent, own: Collection[int]) -> Descent:
    """From where a descent has stopped, a pattern search over a few variables, the others along their derivative.

    Dry friction and gaps make a cost with many small corners, at which derivatives end a descent. Steps that shrink
    from 4 % of each variable to 0.5 % get across them (Hooke and Jeeves 1961).
    """
    point, rows, slopes = found.point, found.rows, found.slopes
    if not own:
        return found
    others = [i for i in range(len(point)) if i not in set(own)]
    basis, _ = np.linalg.qr(slopes[:, others])
    share = PATTERN_FIRST
    while share >= PATTERN_LAST:
        steps = [share * (LOG_SIZE if problem.variables[i].log else max(point[i], NEAR_ZERO)) for i in own]
        trials = np.repeat(point[None], 2 * len(steps), axis=0)
        for row, (index, step) in enumerate(zip(own, steps, strict=True)):
            trials[2 * row : 2 * row + 2, index] += (step, -step)
        trials = np.clip(trials, 0.0, 1.0)
        tried = problem.residuals(trials)
        # what the other variables could take away of each counts before they have moved
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
    problem: Rows, point: np.ndarray, rows: np.ndarray, slopes: np.ndarray, columns: Collection[int]
) -> np.ndarray:
    """(p,) where the first step of a descent over some of the variables would go."""
    chosen = list(columns)
    scale = _scales(problem, point)[chosen]
    room = (-point[chosen] / scale, (1.0 - point[chosen]) / scale)
    step, _ = bounded_step(slopes[:, chosen] * scale, rows, room, 1.0)
    moved = point.copy()
    moved[chosen] = np.clip(point[chosen] + scale * step, 0.0, 1.0)
    return moved


def bounded_step(
    slopes: np.ndarray, rows: np.ndarray, room: tuple[np.ndarray, np.ndarray], radius: float
) -> tuple[np.ndarray, float]:
    """((p,) step in units of the scales, the cost that it should take away) within a box and the trust region."""
    count = slopes.shape[1]
    hessian, gradient = slopes.T @ slopes, slopes.T @ rows
    hessian = hessian + 1e-9 * max(float(np.trace(hessian)), 1.0) * np.eye(count)
    step, scratch = np.zeros((count, 1)), np.zeros((count, count + 7))
    lower = np.maximum(room[0], -radius)[:, None]
    # it wants some room everywhere, and stands still before one that is hardly there
    lower = np.where(lower > -LEAST_ROOM, 0.0, lower)
    upper = np.maximum(np.minimum(room[1], radius)[:, None], lower + LEAST_ROOM)
    mujoco.mju_boxQP(step, scratch, None, hessian, gradient[:, None], lower, upper)
    moved = step[:, 0]
    return moved, float(-2.0 * gradient @ moved - moved @ hessian @ moved)


def _scales(problem: Rows, start: np.ndarray) -> np.ndarray:
    """How far each variable goes in a first step: a nuisance by about two sigma, an effect by about its own size."""
    scales = []
    for variable, unit in zip(problem.variables, start, strict=True):
        if variable.prior is not None:
            scales.append(2.0 * variable.prior.sigma / (variable.high - variable.low))
        else:
            scales.append(LOG_SIZE if variable.log else max(unit, NEAR_ZERO))
    return np.array(scales)
