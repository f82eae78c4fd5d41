"""What negative damping can stand in for: the thumb's error over its damping, the command's onset found or held."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from twin_daemon.simulation.alignment import Aligned, command_onset, model_onset, predict
from twin_daemon.simulation.twin import TwinModel

_FACTORS = (-0.6, -0.4, -0.3, -0.2, -0.1, 0.0, 0.5, 1.0, 2.0, 3.0)
_START = 0.05  # N m s/rad, where the dissertation's search began
LATE_S = 0.02


@dataclass(frozen=True)
class Point:
    """Errors in rad^2 with one damping at all joints of the thumb; null where the simulation diverges.

    `anew` with the onset that suits this damping best, `held` with the raw command's, `late` with one 20 ms later.
    """

    damping: float
    anew_rad2: float | None
    held_rad2: float | None
    late_rad2: float | None


def damping_scan(twin: TwinModel, aligned: Aligned) -> list[Point]:
    """The error by damping. A twin refuses a negative one, so that it is written into the compiled model."""
    thumb = [i for i, name in enumerate(twin.joints) if name in twin.hand.description.groups["thumb"]]
    moving = [i for i in thumb if aligned.moving[i]]
    onset = command_onset(twin, aligned)
    points = []
    for factor in _FACTORS:
        changed = copy.copy(twin)
        changed.model = copy.copy(twin.model)
        changed.model.dof_damping[twin.dof_adr[thumb]] = factor * _START
        onsets = (model_onset(changed, aligned), onset, onset + LATE_S)
        errors = [_error(changed, aligned.with_onset(at), moving) for at in onsets]
        points.append(Point(factor * _START, *errors))
    return points


def _error(twin: TwinModel, aligned: Aligned, columns: list[int]) -> float | None:
    predicted = predict(twin, aligned)[:, columns]
    return float(np.nanmean((aligned.measured[:, columns] - predicted) ** 2)) if np.isfinite(predicted).all() else None
