"""Whether the hand moves, as measured: what a stop has to say of it, whoever drives it."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np

WINDOW_S = 0.7
"""So far back it is looked: a second after a stop this leaves out the 0.3 s in which what moved comes to rest."""
MOVES_RAD = 0.02
"""Farther than this within the window is a movement: 1.2 degrees, far above the noise of every sensor described."""
_APART_S = 0.02
_LEAST_S = 0.5  # of the window that must have been seen


class Movement:
    """The measured poses of the last moments. One thread adds, any thread asks."""

    def __init__(self, joints: Sequence[str]) -> None:
        self._joints = tuple(joints)
        self._poses: deque[tuple[float, np.ndarray]] = deque(maxlen=int(2.0 * WINDOW_S / _APART_S))

    def add(self, position: np.ndarray, now_s: float) -> None:
        """Joints (j,) rad, NaN where not known yet, measured at `now_s`."""
        if not self._poses or now_s - self._poses[-1][0] >= _APART_S or now_s < self._poses[-1][0]:
            self._poses.append((now_s, position.copy()))

    def look(self, now_s: float) -> dict[str, Any]:
        """`hand_moves` (None: the hand was not heard all the time) and `moved_rad` by joint, of those that move."""
        seen = [(at, pose) for at, pose in list(self._poses) if now_s - WINDOW_S <= at <= now_s]
        if len(seen) < 3 or seen[-1][0] - seen[0][0] < _LEAST_S:
            return {"hand_moves": None, "moved_rad": {}}
        poses = np.array([pose for _, pose in seen])
        way = np.nan_to_num(poses.max(axis=0) - poses.min(axis=0))
        moved = {self._joints[i]: float(way[i]) for i in np.flatnonzero(way > MOVES_RAD)}
        return {"hand_moves": bool(moved), "moved_rad": moved}
