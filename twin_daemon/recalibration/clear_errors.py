"""Errors of two twins of one hand on the same motion, where what no model has right is left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.comparison.compare import compare_recording
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.subproblems import touching
from twin_daemon.simulation.alignment import Aligned, moving_joints
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.twin import TwinModel

_LEAST_S = 0.3  # of a part's motion, to be judged by it


def clear_residuals(twins: Sequence[TwinModel], recordings: Sequence[Aligned]) -> list[list[np.ndarray]]:
    """For each recording and each twin measured minus predicted where nothing touches, (n, j) rad.

    A recording without contacts is one free roll-out. Where parts of the hand touch each other, each is predicted on
    its own from where it stands clear of everything to the next contact, and its samples in between are NaN. Where no
    part is ever clear it is the roll-out of the whole hand.
    """
    return [_of(twins, recording) for recording in recordings]


def _of(twins: Sequence[TwinModel], recording: Aligned) -> list[np.ndarray]:
    if not recording.onset_free and touching(twins[0], recording):
        reduction = Reduction(twins[0], [recording], [])
        apart = [recording.measured - _predicted_apart(reduction, twin, recording) for twin in twins]
        if np.isfinite(apart[0]).any():
            return apart
    return [compare_recording(twin, recording).residual for twin in twins]


def _predicted_apart(reduction: Reduction, twin: TwinModel, recording: Aligned) -> np.ndarray:
    """(n, j) rad: each moving part on its own, NaN where it touches something."""
    found = np.full(recording.measured.shape, np.nan)
    moving = moving_joints([recording])
    for part in parts(twin):
        own = [name for name in part.joints if name in moving]
        reduced = reduction.of(twin, part, own, least_s=_LEAST_S) if own else None
        if reduced is not None:
            found[:, [twin.joints.index(name) for name in own]] = _predicted(reduced, recording)
    return found


def _predicted(reduced: Reduced, recording: Aligned) -> np.ndarray:
    """(n, k) rad: what the pieces of one part predict on the recording's own clock, NaN between them."""
    problem = Problem(reduced.twin, reduced.train, (), reduced.joints)
    found = np.full((len(recording.time_s), len(reduced.joints)), np.nan)
    for piece, read in zip(reduced.train, problem.predict(np.zeros((1, 0))), strict=True):
        first = int(np.searchsorted(recording.time_s, recording.onset_s - piece.onset_s - 1e-9))
        rows = found[first : first + len(piece.time_s)]
        scored = np.isfinite(piece.measured).any(axis=1)
        rows[scored] = read[0][scored]
    return found
