"""Whether the hand would run into itself on its way, and why the motion then ends."""

from __future__ import annotations

import itertools

import numpy as np

from twin_daemon.gate.motion_monitor import MotionMonitor, ProtectiveStop
from twin_daemon.gate.preview import Preview
from twin_daemon.gate.shaper import Shaper

_SHARES = (0.5, 0.25, 0.1)


def in_the_way(
    preview: Preview, monitor: MotionMonitor, pose: np.ndarray, now: np.ndarray, then: np.ndarray
) -> ProtectiveStop | None:
    """The protective stop where the hand, measured at `pose` (j,) rad, would overlap itself between two sets of targets
    (c,) rad: where it is sent, and where it is as long as some of it does not follow. A finger that is blocked is not
    out of its neighbours' way."""
    found = preview.first_collision(pose, now, then)
    if found is not None:
        return ProtectiveStop("collision", str(found))
    if not monitor.suspects:
        return None
    behind = monitor.suspected
    found = preview.first_collision(pose, np.where(behind, np.nan, now), np.where(behind, np.nan, then))
    if found is None:
        return None
    names = ", ".join(itertools.compress(monitor.tracking.names, behind))
    return ProtectiveStop("tracking", f"{names} does not follow, and {found}")


def way_back(
    preview: Preview, shaper: Shaper, pose: np.ndarray, now: np.ndarray, goal: np.ndarray, dt_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Setpoints and velocities (c,) one turn later on the way to `goal` (c,) rad, where a hand lets go, and (c,) bool:
    which of them go less far or brake, because the hand would overlap itself. `now` (c,) rad is where it is sent.

    A dead sensor reads what one of a blocked finger does, but the finger is where it was sent, and its neighbours may
    have moved since. One that truly is blocked is no deeper in its neighbour than the geometry is wrong.
    """
    goes = np.full(len(goal), np.nan)
    short = np.zeros(len(goal), dtype=bool)

    def try_with(which: np.ndarray, share: float) -> bool:
        tried = goes.copy()
        tried[which] = shaper.position[which] + share * (goal[which] - shaper.position[which])
        position, velocity = shaper.toward(tried, dt_s)
        if velocity.any():
            then = np.where(shaper.given, shaper.stopping(position, velocity), now)
            if preview.first_collision(pose, now, then) is not None:
                return False
        goes[which] = tried[which]
        return True

    def add(which: np.ndarray) -> None:
        if try_with(which, 1.0):
            return
        if len(which) > 1:
            add(which[: len(which) // 2])
            add(which[len(which) // 2 :])
            return
        short[which] = True
        next((share for share in _SHARES if try_with(which, share)), None)

    add(np.flatnonzero(np.isfinite(goal) & shaper.given))
    return *shaper.toward(goes, dt_s), short
