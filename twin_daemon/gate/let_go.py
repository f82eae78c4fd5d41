"""After a stop or a trip the setpoints go back to where the hand is, so that it presses against nothing."""

from __future__ import annotations

import numpy as np

_FOLLOWS_S = 0.5  # what was pressed springs back meanwhile
_THERE_RAD = 1e-6


class LetGo:
    """Where setpoints (c,) rad go that would come to `rest` while the hand is at `measured`: no farther from it than
    `margin` (c,), which holds the links up. NaN where nothing is known of the hand: there a setpoint stays at its rest.

    For half a second the goals follow a hand that springs back, never the other way: a sensor that turned its sign
    could otherwise swing them to and fro.
    """

    def __init__(self, rest: np.ndarray, measured: np.ndarray, margin: np.ndarray, now_s: float) -> None:
        self._margin = margin
        self._until_s = now_s + _FOLLOWS_S
        self.goal = _near(rest, measured, margin)
        self._way = np.sign(self.goal - rest)
        self.is_needed = bool((np.abs(self.goal - rest) > _THERE_RAD).any())

    def follow(self, measured: np.ndarray, now_s: float) -> np.ndarray:
        """The goals (c,) now."""
        if now_s < self._until_s:
            farther = _near(self.goal, measured, self._margin)
            self.goal = np.where(self._way * (farther - self.goal) > 0.0, farther, self.goal)
        return self.goal

    def is_done(self, setpoint: np.ndarray, now_s: float) -> bool:
        return now_s >= self._until_s and not (np.abs(setpoint - self.goal) > _THERE_RAD).any()


def _near(rest: np.ndarray, measured: np.ndarray, margin: np.ndarray) -> np.ndarray:
    return measured + np.minimum(np.maximum(rest - measured, -margin), margin)
