"""What uncertain starts do to a part: where fifty samples a second show no speed, or where nothing forgets it.

A joint that its servo holds forgets within the servo's time how fast it went at the start of a piece. With few samples
and fine sensors that is still a hundred times their noise: a sound arm was called worn for it. The split of two joints
on one tendon, which no servo holds apart, keeps what came of it until the piece ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin_daemon.estimation.floor import floor_variance
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.thresholds import START_FLOORS, START_SHOWS
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.prescribed import response_time_s
from twin_daemon.simulation.twin import TwinModel


def with_start_errors(twin: TwinModel, pieces: Sequence[Aligned], joints: Sequence[str]) -> list[Aligned]:
    """The pieces with what a standard deviation of each start position and velocity does to the joints' readings.

    As they are where that is less than a sensor shows: where each of the joints has a servo of its own, no more comes
    of a start than its speed makes in the servo's time.
    """
    if not pieces or any(piece.start_sigma is None for piece in pieces):
        return list(pieces)
    held = each_held(twin, joints)
    floor = np.sqrt(floor_variance(pieces, joints))
    time_s = np.array([response_time_s(twin, joint) for joint in joints])
    columns = [twin.joints.index(joint) for joint in joints]
    chosen = [
        index
        for index, piece in enumerate(pieces)
        if piece.start_sigma is not None
        and (
            not held
            or (
                np.hypot(piece.start_sigma[0, columns], piece.start_sigma[1, columns] * time_s) > START_FLOORS * floor
            ).any()
        )
    ]
    if not chosen:
        return list(pieces)
    shown = [pieces[index] for index in chosen]
    moves = [(order, column) for order in range(2) for column in columns]
    begun = [[piece, *(_moved(piece, *move) for move in moves)] for piece in shown]
    read = Problem(twin, shown, (), joints).beginning(begun).predict(np.zeros((1 + len(moves), 0)))
    out = list(pieces)
    for index, piece, after in zip(chosen, shown, read, strict=True):
        response = np.zeros((len(moves), len(piece.time_s), len(twin.joints)))
        response[:, :, columns] = np.nan_to_num(after[1:] - after[:1])
        out[index] = replace(piece, start_response=response)
    return out


def each_held(twin: TwinModel, joints: Sequence[str]) -> bool:
    """Whether there is a servo for each of the joints: what two on one tendon do apart is held by none."""
    return len(joints) <= sum(bool(set(driven) & set(joints)) for driven in twin.driven)


def _moved(piece: Aligned, order: int, column: int) -> Aligned:
    """A piece that starts a standard deviation away (`order` 0) or faster (1) at one joint."""
    assert piece.start_sigma is not None
    start = np.array([piece.start_position, piece.start_velocity])
    start[order, column] += piece.start_sigma[order, column]
    return replace(piece, start_position=start[0], start_velocity=start[1])


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
        shows = sizes > START_SHOWS
        self._ways, self._taken = ways[:, shows], 1.0 - 1.0 / np.sqrt(1.0 + sizes[shows] ** 2)

    def __call__(self, residuals: np.ndarray) -> np.ndarray:
        """(B, n, k) rad -> (B, n, k) rad."""
        rows = (residuals / self._sigma).reshape(len(residuals), -1)
        rows = rows - (rows @ self._ways * self._taken) @ self._ways.T
        return rows.reshape(residuals.shape) * self._sigma
