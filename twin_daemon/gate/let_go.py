"""After a stop of any kind the setpoints go back to where the hand is, so that it presses against nothing."""

from __future__ import annotations

import numpy as np

_FOLLOWS_S = 0.5  # what was pressed springs back meanwhile
_THERE_RAD = 1e-6
_PROOF_RAD = 0.1


class Path:
    """What setpoints and readings (c,) rad have done since somebody armed.

    A sensor is proven once its reading has gone along with a setpoint. Until then nothing is sent where no setpoint has
    been: what the hand seems to do may be what a reversed sensor, or one in degrees, makes of it.
    """

    def __init__(self, count: int) -> None:
        self._sent, self._read, self._low, self._high = np.full((4, count), np.nan)
        self._proven = np.zeros(count, dtype=bool)

    def add(self, setpoint: np.ndarray, measured: np.ndarray) -> None:
        fresh = np.isnan(self._sent) & np.isfinite(setpoint)
        if np.count_nonzero(fresh):
            self._sent[fresh], self._read[fresh] = setpoint[fresh], measured[fresh]
        np.fmin(self._low, setpoint, out=self._low)
        np.fmax(self._high, setpoint, out=self._high)
        sent = setpoint - self._sent
        way = np.abs(sent)
        far = (way >= _PROOF_RAD) & ~self._proven
        if np.count_nonzero(far):
            went = np.sign(sent) * (measured - self._read)
            self._proven |= far & (went >= _PROOF_RAD) & (went <= 2.0 * way)

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest setpoints that the readings may call for."""
        free = self._proven | np.isnan(self._low)
        return np.where(free, -np.inf, self._low), np.where(free, np.inf, self._high)


class LetGo:
    """Where setpoints (c,) rad go that would come to `rest` while the hand is at `measured`: no farther from it than
    `margin` (c,), which holds the links up. NaN where nothing is known of the hand: there a setpoint stays at its rest.

    For half a second the goals follow a hand that springs back, never the other way and never out of the `bounds`.
    """

    def __init__(
        self,
        rest: np.ndarray,
        measured: np.ndarray,
        margin: np.ndarray,
        bounds: tuple[np.ndarray, np.ndarray],
        now_s: float,
    ) -> None:
        self._margin = margin
        self._until_s = now_s + _FOLLOWS_S
        self._low, self._high = bounds
        self.goal = self._near(rest, measured)
        self._rest = rest
        self._way = np.sign(self.goal - rest)

    @property
    def is_needed(self) -> bool:
        """Whether any setpoint goes back, and does not only stay where it comes to rest."""
        return bool((np.abs(self.goal - self._rest) > _THERE_RAD).any())

    def follow(self, measured: np.ndarray, now_s: float) -> np.ndarray:
        """The goals (c,) now."""
        if now_s < self._until_s:
            farther = self._near(self.goal, measured)
            self.goal = np.where(self._way * (farther - self.goal) > 0.0, farther, self.goal)
        return self.goal

    def is_done(self, setpoint: np.ndarray, now_s: float, short: np.ndarray) -> bool:
        """Whether all are there but those (c,) bool whose way is not free."""
        return now_s >= self._until_s and not ((np.abs(setpoint - self.goal) > _THERE_RAD) & ~short).any()

    def not_back(self, names: tuple[str, ...], setpoint: np.ndarray) -> str | None:
        """What is told of those that are not there."""
        away = np.abs(setpoint - self.goal).tolist()
        which = [f"{name} stays {one:.2f} rad" for name, one in zip(names, away, strict=True) if one > _THERE_RAD]
        if not which:
            return None
        return f"{', '.join(which)} away from where the hand is measured: it would overlap itself there"

    def _near(self, rest: np.ndarray, measured: np.ndarray) -> np.ndarray:
        near = measured + np.minimum(np.maximum(rest - measured, -self._margin), self._margin)
        return np.minimum(np.maximum(near, self._low), self._high)
