"""Whether the hand moves as it is sent: a sensor that is dead stands still, one that is reversed goes the other way."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from twin_daemon.gate.tracking import Tracking

_WINDOW_S = 0.3
_SHOULD_RAD = 0.1  # a twin that moves less within the window says nothing of the hand
_TOO_FAR = 3.0
_AGAINST_RAD = 0.03  # a hand that is pushed or swings may give so much


@dataclass(frozen=True)
class Odd:
    """Why a command does not move as it should. `kind` is frozen, wrong_way or too_far."""

    kind: str
    why: str


class Response:
    """Compares how far hand and twin moved within the last 0.3 s, by command (c,), in rad. What is odd for the time of
    `tracking` is told; a hand lags, so that for a moment it may go on while the twin turns round."""

    def __init__(self, tracking: Tracking) -> None:
        self._names, self._time_s, self._blur = tracking.names, tracking.time_s, tracking.blur
        # a site that lets a grasp press by more knows that the hand stands still meanwhile
        self._least = np.maximum(_SHOULD_RAD, tracking.floor)
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self.forget()

    def forget(self) -> None:
        """What comes begins at rest."""
        self._past.clear()
        self._expected: np.ndarray | None = None
        self._should = self._did = np.zeros(len(self._names))
        self._odd_s = np.full((2, len(self._names)), np.nan)  # frozen, wrong way: arrival of the first such measurement
        self.off = False
        """Whether a command is odd at the moment."""

    @property
    def which(self) -> np.ndarray:
        """(c,) bool: which commands are odd at the moment."""
        still, against = np.isfinite(self._odd_s)
        return still | against

    def sent(self, now_s: float, expected: np.ndarray) -> None:
        """Where the twin is from now on; NaN for commands that are not driven."""
        self._expected = expected

    def look(self, measured: np.ndarray, arrival_s: np.ndarray) -> Odd | None:
        """What is odd for too long, if anything is."""
        if self._expected is None:
            return None
        heard_s = float(arrival_s.max())
        if not self._past or heard_s > self._past[-1][0]:
            self._past.append((heard_s, self._expected, measured))
        while self._past[0][0] < heard_s - _WINDOW_S:
            self._past.popleft()
        _, expected, before = self._past[0]
        self._should, self._did = self._expected - expected, measured - before
        odd = self._odd(self._least, _SHOULD_RAD)
        was_off, self.off = self.off, odd is not None and bool(np.count_nonzero(odd))
        if not self.off or odd is None:
            if was_off:
                self._odd_s[:] = np.nan
            return None
        self._odd_s = np.where(odd, np.where(np.isfinite(self._odd_s), self._odd_s, arrival_s), np.nan)
        late = odd & (arrival_s - self._odd_s >= self._time_s)
        if not late.any():
            return None
        kind, i = np.unravel_index(int(np.argmax(late)), late.shape)
        return self._told(int(kind), int(i))

    def cause(self, command: str) -> Odd | None:
        """What may be the cause where a command is not where it should be."""
        i = self._names.index(command)
        should, did = self._should[i], self._did[i]
        odd = self._odd(_AGAINST_RAD, _AGAINST_RAD)
        if odd is not None and odd[:, i].any():
            return self._told(int(odd[:, i].argmax()), i)
        if np.sign(should) * did > _TOO_FAR * abs(should) + _SHOULD_RAD:
            why = (
                f"it has moved by {did:+.2f} rad, and should have moved by {should:+.2f} rad: is its driver's unit rad?"
            )
            return Odd("too_far", why)
        return None

    def _odd(self, still_rad: np.ndarray | float, against_rad: float) -> np.ndarray | None:
        """(2, c) bool: which commands stand still, which go the other way, where the twin has moved by so much; None
        where it has not moved."""
        way = np.abs(self._should)
        moves = way >= against_rad
        if not np.count_nonzero(moves):  # `still_rad` is never less
            return None
        odd = np.empty((2, len(self._names)), dtype=bool)
        np.logical_and(way >= still_rad, np.abs(self._did) <= self._blur, out=odd[0])
        np.logical_and(moves, np.sign(self._should) * self._did <= -_AGAINST_RAD - self._blur, out=odd[1])
        return odd

    def _told(self, kind: int, i: int) -> Odd:
        name, should = self._names[i], f"and should have moved by {self._should[i]:+.2f} rad"
        if kind == 0:
            return Odd("frozen", f"{name} has not moved at all, {should}: it is blocked, or its sensor is dead")
        why = f"{name} has moved by {self._did[i]:+.2f} rad, {should}: something moves it, or its sensor is reversed"
        return Odd("wrong_way", why)
