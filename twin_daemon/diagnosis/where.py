"""Where a model fails: the residual by joint and by what the joint was doing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from twin_daemon.comparison.conditions import errors_by_condition
from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.twin import TwinModel

_WORST = 12
_KEYS = ("joint", "condition", "rmse_rad", "bias_rad", "times_average", "seconds")


def where_it_fails(twin: TwinModel, recordings: Sequence[Aligned]) -> list[dict[str, Any]]:
    """Joints and conditions with the largest errors, worst first.

    Each has the joint, the condition in words, its root mean square error (rad), how much worse that is than the
    joint's own average, and how many seconds of motion it rests on.
    """
    errors = errors_by_condition((recording, predict(twin, recording)) for recording in recordings)
    return [{key: getattr(error, key) for key in _KEYS} for error in errors[:_WORST]]
