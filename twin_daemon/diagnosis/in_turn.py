"""Motions that are held out in turn: each is predicted by what all the others say.

Leaving one recording out moves a fit a little: one Gauss-Newton step from where all of them have put it, with its rows
taken out (the infinitesimal jackknife; Giordano, Stephenson, Liu, Jordan and Broderick 2019, "A Swiss Army
infinitesimal jackknife"). Friction has corners, where that step is none: of it, its half, its quarter and none the one
counts at which the others are fitted best. That costs four roll-outs a recording, where fitting anew costs a hundred.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.thresholds import BOX_INFORMATION
from twin_daemon.simulation.alignment import Aligned

_SHARES = np.array([0.0, 0.25, 0.5, 1.0])  # of the step


def motion_of(piece: Aligned) -> str:
    """What tells a recording from others: its bytes and its name."""
    return f"{piece.recording.sha256}:{piece.recording.name}"


def by_motion(pieces: Sequence[Aligned]) -> dict[str, list[int]]:
    """Indices of the pieces of each recording."""
    found: dict[str, list[int]] = {}
    for index, piece in enumerate(pieces):
        found.setdefault(motion_of(piece), []).append(index)
    return found


def fitted_too(fitted: Sequence[Aligned], held: Sequence[Aligned]) -> frozenset[str]:
    """The held-out recordings of which the same samples are fitted: those that take turns.

    Stretches of one recording are hidden from a fit and shown to its judge: they share no sample. With one recording
    there are no others to speak for it.
    """
    if len(by_motion(fitted)) < 2:
        return frozenset()
    known: dict[str, list[Aligned]] = {}
    for piece in fitted:
        known.setdefault(motion_of(piece), []).append(piece)
    return frozenset(
        motion_of(piece) for piece in held if any(_same(piece, own) for own in known.get(motion_of(piece), ()))
    )


def _same(piece: Aligned, other: Aligned) -> bool:
    both = (piece.measured, other.measured)
    return both[0].shape == both[1].shape and np.array_equal(*both, equal_nan=True)


def without_each(
    problem: Posterior, point: np.ndarray, slopes: np.ndarray, inflation: float
) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """(the point (p,) as the others have it, the slopes (m, p) of their rows), by the recording that is left out.

    `inflation` is the residual over its floor: what is above it is no noise of the size assumed.
    """
    blocks = problem.blocks()
    rows = problem.residuals(point[None])[0]
    found = {}
    for motion, members in by_motion(problem.recordings).items():
        own = np.zeros(len(rows), bool)
        for index in members:
            own[slice(*blocks[index])] = True
        others = slopes[~own]
        information = others.T @ others / inflation + BOX_INFORMATION * np.eye(len(point))
        step = np.linalg.solve(information, slopes[own].T @ rows[own] / inflation)
        tried = [(_cost(problem, at, ~own), at) for at in np.clip(point + _SHARES[:, None] * step, 0.0, 1.0)]
        found[motion] = (min(tried, key=lambda one: one[0])[1], others)
    return found


def _cost(problem: Posterior, point: np.ndarray, counted: np.ndarray) -> float:
    """The cost of some of the rows (m,) at a point (p,)."""
    try:
        rows = problem.residuals(point[None])[0]
    except BadInput:  # values that cannot stand together, such as a friction below none
        return np.inf
    return float((rows[counted] ** 2).sum())
