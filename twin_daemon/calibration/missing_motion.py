"""What the motions of a set lack, joint by joint: load, speeds, reversals, holds reached from both sides.

What cannot be seen in a motion is not known after a fit to it, however well it fits. A friction that grows with the
load needs two loads, damping and dry friction need two speeds, play and friction need reversals; and a controller that
is silent about its target is told from dry friction by holds that are reached from both sides, at two loads.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.comparison.conditions import directions, smooth_speed
from twin_daemon.comparison.region import quantities, static_load
from twin_daemon.estimation.thresholds import (
    FELT_LOAD_RAD,
    HELD_S,
    LEAST_REVERSALS,
    LOAD_POSES,
    LOADED_SHARE,
    TWO_LOADS,
    TWO_SPEEDS,
)
from twin_daemon.simulation.alignment import MOVING_RAD, Aligned, moving_joints
from twin_daemon.simulation.turns import turning_points
from twin_daemon.simulation.twin import TwinModel

WORDS = {
    "load": "load: let gravity pull at it from more of its range, or give it something to hold",
    "speed": "speed: move at two speeds, one three times the other",
    "reversals": "reversals: turn back some times, by little and by much",
    "holds": "holds: come to rest at the same place from both sides, at two loads",
}
"""What is missing, and the motion that brings it."""


@dataclass(frozen=True)
class Missing:
    """What a joint lacks in all the motions of a set, in the words of `WORDS`. A joint that is still lacks all."""

    joint: str
    lacks: tuple[str, ...]


def missing_motion(twin: TwinModel, recordings: Sequence[Aligned]) -> list[Missing]:
    """The joints that lack something, the poorest first."""
    moving = moving_joints(recordings)
    possible = _possible_load(twin)
    seen = [quantities(twin, recording) for recording in recordings]
    found = []
    for column, joint in enumerate(twin.joints):
        if joint not in moving:
            if any(np.isfinite(r.measured[:, column]).any() for r in recordings):
                found.append(Missing(joint, tuple(WORDS)))
            continue
        load = np.concatenate([one["load"][:, column] for one in seen])
        felt = possible[column] > FELT_LOAD_RAD * max(twin.scale(joint).kp, 0.0)
        lacks = []
        if felt and np.nanmax(load) - np.nanmin(load) < LOADED_SHARE * possible[column]:
            lacks.append("load")
        if not _two_speeds([r for r in recordings if r.moving[column]], column):
            lacks.append("speed")
        if sum(_reversals(r, column) for r in recordings) < LEAST_REVERSALS:
            lacks.append("reversals")
        if not _held_from_both_sides(twin, recordings, column, possible[column] if felt else None):
            lacks.append("holds")
        if lacks:
            found.append(Missing(joint, tuple(lacks)))
    return sorted(found, key=lambda one: -len(one.lacks))


def _possible_load(twin: TwinModel) -> np.ndarray:
    """(j,) N m: from the least to the most with which gravity and springs can load each joint within its range."""
    low, high = twin.model.jnt_range[twin.model.dof_jntid[twin.dof_adr]].T
    limited = high > low
    low, high = np.where(limited, low, -np.pi), np.where(limited, high, np.pi)
    poses = np.random.default_rng(0).uniform(low, high, (LOAD_POSES, len(twin.joints)))
    return np.ptp(static_load(twin, poses), axis=0)


def _two_speeds(recordings: Sequence[Aligned], column: int) -> bool:
    speeds = np.concatenate([np.abs(smooth_speed(r.time_s, r.measured[:, column])) for r in recordings])
    moving = speeds[directions(speeds) != 0]
    if moving.size < 2:
        return False
    slow, fast = np.quantile(moving, [0.1, 0.9])
    return bool(fast > TWO_SPEEDS * slow)


def _reversals(recording: Aligned, column: int) -> int:
    """How often a joint turns by as much as a joint that moves has to."""
    return max(0, len(turning_points(recording.measured[:, column], MOVING_RAD)) - 1)


def _held_from_both_sides(twin: TwinModel, recordings: Sequence[Aligned], column: int, possible: float | None) -> bool:
    """Whether a joint has been brought to rest from above and from below, at two loads if it can be loaded at all."""
    holds = np.array([hold for recording in recordings for hold in _holds(twin, recording, column)]).reshape(-1, 2)
    if possible is None:
        return {-1.0, 1.0} <= set(holds[:, 0])
    bins = np.floor(holds[:, 1] / (TWO_LOADS * possible))
    return sum({-1.0, 1.0} <= set(holds[bins == one, 0]) for one in np.unique(bins)) >= 2


def _holds(twin: TwinModel, recording: Aligned, column: int) -> list[tuple[float, float]]:
    """(the side from which it was approached as +1 or -1, the load in N m) of each rest of a joint."""
    driving = np.flatnonzero(twin.drive[:, column])
    if not driving.size or not recording.moving[column]:
        return []
    command = recording.controls(twin, recording.time_s)[:, driving[0]]
    change = np.diff(command, prepend=command[0])
    moved = np.flatnonzero(np.abs(change) > 1e-4)
    found = []
    for begin, end in zip(moved, [*moved[1:], len(command) - 1], strict=True):
        if recording.time_s[end] - recording.time_s[begin] < HELD_S:
            continue
        pose = recording.states[max(begin, end - 1)]
        if not np.isfinite(pose[column]):
            continue
        whole = np.where(np.isfinite(pose), pose, np.nan_to_num(recording.start_position))
        load = static_load(twin, twin.measurement.invert(twin.joints, whole[None]))[0, column]
        found.append((float(np.sign(change[begin])), float(load)))
    return found
