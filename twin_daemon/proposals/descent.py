"""How laws are fitted: one linear step for all that compete, a few of Gauss and Newton for those that lead."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from twin_daemon.estimation.posterior import Posterior
from twin_daemon.proposals.thresholds import DAMPINGS, FOLDS, LAW_STEP, LEAST_STEP_GAIN, NUISANCE_STEP


@dataclass(frozen=True)
class Linear:
    """Rows (m,) at a point and their slopes (m, p); `fold` (m,) is the block of each row.

    The priors' rows there are `believed` (q,), with slopes `beliefs` (q, p).
    """

    rows: np.ndarray
    slopes: np.ndarray
    fold: np.ndarray
    believed: np.ndarray
    beliefs: np.ndarray

    def step(self, rows: np.ndarray, width: int, chosen: np.ndarray | slice = slice(None)) -> np.ndarray:
        """(width,) the step of the first `width` variables that fits some of the rows and the priors best."""
        slopes, beliefs = self.slopes[chosen, :width], self.beliefs[:, :width]
        hessian = slopes.T @ slopes + beliefs.T @ beliefs
        gradient = slopes.T @ rows[chosen] + beliefs.T @ self.believed
        return -np.linalg.lstsq(hessian, gradient, rcond=None)[0]

    def beside(self, rows: np.ndarray, own: int) -> np.ndarray:
        """(p,) the step of the variables from `own` on alone that fits other rows (m,) and the priors best."""
        slopes, beliefs = self.slopes[:, own:], self.beliefs[:, own:]
        hessian = slopes.T @ slopes + beliefs.T @ beliefs
        step = np.zeros(self.slopes.shape[1])
        step[own:] = -np.linalg.lstsq(hessian, slopes.T @ rows + beliefs.T @ self.believed, rcond=None)[0]
        return step


def columns(problem: Posterior, point: np.ndarray, chosen: range, step: float) -> tuple[np.ndarray, np.ndarray]:
    """((m,) rows at a point, (m, len(chosen)) their slopes) from one batch of roll-outs."""
    trials = np.repeat(point[None], len(chosen) + 1, axis=0)
    signs = np.where(point[list(chosen)] > 0.5 + 1e-9, -step, step)
    trials[1 + np.arange(len(chosen)), list(chosen)] += signs
    rows = problem.residuals(trials)
    return rows[0], (rows[1:] - rows[0]).T / signs


def folds(problem: Posterior) -> np.ndarray:
    """(m,) the block in time of each row of data: neighbouring pieces share one."""
    sizes = [len(r.time_s) * len(problem.objective) for r in problem.recordings]
    count = min(FOLDS, len(sizes)) if len(sizes) > 1 else FOLDS
    if len(sizes) == 1:
        return np.arange(sizes[0]) * count // sizes[0]
    return np.repeat(np.arange(len(sizes)) % count, sizes)


def cross_validated(found: Linear, own: int, rows: np.ndarray | None = None) -> float:
    """The share of the squared rows that a linear law takes away from blocks that it was not fitted to.

    `own` says where the law's columns begin; what the nuisances before them take away is taken away on both sides. With
    `rows` (m,) other rows than those at the point, such as permuted ones.
    """
    rows = found.rows if rows is None else rows
    left = np.zeros(2)
    for which in np.unique(found.fold):
        test = found.fold == which
        for index, width in enumerate((own, found.slopes.shape[1])):
            step = found.step(rows, width, ~test)
            left[index] += float(((rows[test] + found.slopes[test, :width] @ step) ** 2).sum())
    return 1.0 - left[1] / max(left[0], 1e-30)


@dataclass(frozen=True)
class Reached:
    """Where a descent has come to: point (p,), its rows (m,) and slopes (m, p), priors among them."""

    point: np.ndarray
    rows: np.ndarray
    slopes: np.ndarray

    @property
    def cost(self) -> float:
        return float(self.rows @ self.rows)


class Rows(Protocol):
    """Whatever has rows (B, m) at points (B, p) of unit coordinates."""

    def residuals(self, points: np.ndarray) -> np.ndarray: ...


def gauss_newton(problem: Rows, start: np.ndarray | Reached, own: int, rounds: int) -> Reached:
    """Full derivatives each round; of several damped steps the one that fits best counts.

    Where none fits better they are taken to the other side once: what sticks and slips makes corners in a cost. Where
    another descent of the same problem has come to, it goes on with the slopes that are known there.
    """
    point = start.point if isinstance(start, Reached) else start
    steps, turned = np.where(np.arange(len(point)) < own, NUISANCE_STEP, LAW_STEP), False
    rows, slopes = (start.rows, start.slopes) if isinstance(start, Reached) else _slopes(problem, point, steps)
    for _ in range(rounds):
        cost, hessian = float(rows @ rows), slopes.T @ slopes
        size = np.diag(hessian).copy()
        trials = [
            np.clip(
                point
                - np.linalg.lstsq(
                    hessian + damping * np.diag(size) + 1e-9 * size.max(initial=1.0) * np.eye(len(point)),
                    slopes.T @ rows,
                    rcond=None,
                )[0],
                0.0,
                1.0,
            )
            for damping in DAMPINGS
        ]
        tried = problem.residuals(np.array(trials))
        costs = (tried**2).sum(axis=1)
        best = int(np.argmin(costs))
        if costs[best] >= cost:
            if turned:
                break
            steps, turned = -steps, True
            rows, slopes = _slopes(problem, point, steps)
            continue
        point = trials[best]
        gained = 1.0 - costs[best] / cost
        rows, slopes = _slopes(problem, point, steps)
        if gained < LEAST_STEP_GAIN:
            break
    return Reached(point, rows, slopes)


def _slopes(problem: Rows, point: np.ndarray, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    signed = np.where(point > 0.5 + 1e-9, -steps, steps)
    rows = problem.residuals(np.concatenate([point[None], point[None] + np.diag(signed)]))
    return rows[0], (rows[1:] - rows[0]).T / signed
