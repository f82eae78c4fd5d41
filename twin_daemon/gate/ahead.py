"""Whether the hand would run into itself on its way, and why the motion then ends."""

from __future__ import annotations

import itertools

import numpy as np

from twin_daemon.gate.preview import Preview
from twin_daemon.gate.trips import Trip, Trips


def in_the_way(preview: Preview, trips: Trips, pose: np.ndarray, now: np.ndarray, then: np.ndarray) -> Trip | None:
    """The trip where the hand, measured at `pose` (j,) rad, would overlap itself between two sets of targets (c,) rad:
    where it is sent, and where it is as long as some of it does not follow. A finger that is blocked is not out of its
    neighbours' way."""
    found = preview.first_collision(pose, now, then)
    if found is not None:
        return Trip("collision", str(found))
    if not trips.suspects:
        return None
    behind = trips.suspected
    found = preview.first_collision(pose, np.where(behind, np.nan, now), np.where(behind, np.nan, then))
    if found is None:
        return None
    names = ", ".join(itertools.compress(trips.tracking.names, behind))
    return Trip("tracking", f"{names} does not follow, and {found}")
