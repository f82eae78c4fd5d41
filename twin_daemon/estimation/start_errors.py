"""What uncertain starts do to a part whose joints no servo holds apart: the split of a coupled pair forgets nothing.

A joint that its servo holds has forgotten within a tenth of a second how fast it went at the start of a piece. The
split of two joints on one tendon keeps what came of it until the piece ends: several times the noise of its sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.estimation.problem import Problem
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


def with_start_errors(twin: TwinModel, pieces: Sequence[Aligned], joints: Sequence[str]) -> list[Aligned]:
    """The pieces with what a standard deviation of each start velocity does to the joints' readings.

    As they are where each of the joints has a servo of its own.
    """
    servos = sum(bool(set(driven) & set(joints)) for driven in twin.driven)
    if len(joints) <= servos or not pieces or any(piece.start_velocity_sigma is None for piece in pieces):
        return list(pieces)
    nothing = np.zeros((1, 0))
    before = Problem(twin, pieces, (), joints, threads=1).predict(nothing)
    columns = [twin.joints.index(joint) for joint in joints]
    responses = [np.zeros((len(joints), len(piece.time_s), len(twin.joints))) for piece in pieces]
    for number, column in enumerate(columns):
        moved = Problem(twin, [_faster(piece, column) for piece in pieces], (), joints, threads=1).predict(nothing)
        for response, after, was in zip(responses, moved, before, strict=True):
            response[number][:, columns] = np.nan_to_num(after[0] - was[0])
    return [replace(piece, start_response=response) for piece, response in zip(pieces, responses, strict=True)]


def _faster(piece: Aligned, column: int) -> Aligned:
    """A piece that starts a standard deviation faster at one joint."""
    assert piece.start_velocity_sigma is not None
    velocity = piece.start_velocity.copy()
    velocity[column] += piece.start_velocity_sigma[column]
    return replace(piece, start_velocity=velocity)


class Whitening:
    """Residuals of a piece less what its start may have done to them: the sum of squares is the marginal one.

    With responses S of unit variance and noise of variance f the covariance is f + S' S; what is taken off along each
    of its directions is 1 - 1 / sqrt(1 + power).
    """

    def __init__(self, response: np.ndarray, sigma: np.ndarray) -> None:
        """`response` (s, n, k) rad, `sigma` (k,) rad: what counts as independent noise of one sample."""
        self._sigma = sigma
        rows = (response / sigma).reshape(len(response), -1)
        ways, sizes, _ = np.linalg.svd(rows.T, full_matrices=False)
        self._ways, self._taken = ways, 1.0 - 1.0 / np.sqrt(1.0 + sizes**2)

    def __call__(self, residuals: np.ndarray) -> np.ndarray:
        """(B, n, k) rad -> (B, n, k) rad."""
        rows = (residuals / self._sigma).reshape(len(residuals), -1)
        rows = rows - (rows @ self._ways * self._taken) @ self._ways.T
        return rows.reshape(residuals.shape) * self._sigma
