"""Whether the hand follows: how far it may lag behind its setpoints is what the twin lags behind the same setpoints."""

from __future__ import annotations

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.settings import GateSettings, TrackingLimit
from twin_daemon.hand import Hand, match

_MEMORY_S = 0.25  # the twin turns round a little sooner or later than the hand
_NOISE = 6.0  # standard deviations


class Tracking:
    """Compares each measurement with where the hand was sent when it arrived. All arrays by command, (c,), in rad.

    A command may be `tracking_ratio` times as far from its setpoint as the twin has been in the last quarter of a
    second, and its floor: noise and resolution of its sensors and what the site allows beside. Never farther than
    `tracking_error_rad`. `blur` is what noise and resolution make of a joint at rest, `time_s` how long it may be off.
    """

    def __init__(self, hand: Hand, settings: GateSettings) -> None:
        self.names = hand.commands
        self._ratio, self._most_rad = settings.tracking_ratio, settings.tracking_error_rad
        given = {_command(hand, name): limit for name, limit in settings.tracking.items()}
        limits = [given.get(name, TrackingLimit()) for name in hand.commands]
        joints = hand.description.joints
        self.blur = np.array(
            [
                sum(_NOISE * joints[j].noise_rad + joints[j].resolution_rad for j in info.joints)
                for info in hand.description.commands.values()
            ]
        )
        floor = [settings.tracking_floor_rad if one.floor_rad is None else one.floor_rad for one in limits]
        self.floor = np.array(floor) + self.blur
        self.time_s = np.array([settings.tracking_time_s if one.time_s is None else one.time_s for one in limits])
        self._past = _Past(len(self.names))
        self.forget()

    def forget(self) -> None:
        """A new motion begins at rest."""
        self._past.clear()
        self.off = False
        """Whether any command is off at the moment."""
        self._off_s = np.full(len(self.names), np.nan)  # arrival of the first measurement that was off
        self._away = np.zeros(len(self.names))
        self._allowed = np.zeros(len(self.names))

    @property
    def which(self) -> np.ndarray:
        """(c,) bool: which commands are off at the moment."""
        return np.isfinite(self._off_s)

    def sent(self, now_s: float, setpoint: np.ndarray, expected: np.ndarray) -> None:
        """The setpoints in force from now on, and where the twin is."""
        self._past.append(now_s, setpoint, np.abs(setpoint - expected))

    def look(self, measured: np.ndarray, arrival_s: np.ndarray) -> tuple[str, str] | None:
        """The command that has been off for too long, if one has, and what a protective stop says of it."""
        if not len(self._past):
            return None
        setpoint, lag = self._past.at(float(arrival_s.max()))
        self._allowed = np.minimum(self._ratio * lag + self.floor, self._most_rad)
        self._away = np.abs(setpoint - measured)
        off = self._away > self._allowed
        was_off, self.off = self.off, bool(np.count_nonzero(off))
        if not self.off:
            if was_off:
                self._off_s[:] = np.nan
            return None
        self._off_s = np.where(off, np.where(np.isfinite(self._off_s), self._off_s, arrival_s), np.nan)
        late = off & (arrival_s - self._off_s >= self.time_s)
        if not late.any():
            return None
        i = int(np.argmax(np.where(late, self._away - self._allowed, -np.inf)))
        off_s = arrival_s[i] - self._off_s[i]
        return self.names[i], (
            f"{self.names[i]} is {self._away[i]:.2f} rad from where it was sent, for {off_s:.2f} s; its twin says "
            f"{self._allowed[i]:.2f} rad at most"
        )


class _Past:
    """Setpoints and lags (c,) of the last moments, in arrays that are moved now and then: every turn looks at them."""

    def __init__(self, count: int) -> None:
        self._at_s = np.empty(512)
        self._rows = np.empty((2, 512, count))  # setpoints, lags
        self._end = 0

    def __len__(self) -> int:
        return self._end

    def clear(self) -> None:
        self._end = 0

    def append(self, now_s: float, setpoint: np.ndarray, lag: np.ndarray) -> None:
        if self._end == len(self._at_s):
            first = int(np.searchsorted(self._at_s, now_s - 4.0 * _MEMORY_S))
            at_s, rows = self._at_s[first:].copy(), self._rows[:, first:].copy()
            if 2 * len(at_s) > self._end:  # a gate that turns faster
                self._at_s = np.empty(2 * self._end)
                self._rows = np.empty((2, 2 * self._end, rows.shape[2]))
            self._end = len(at_s)
            self._at_s[: self._end], self._rows[:, : self._end] = at_s, rows
        self._at_s[self._end] = now_s
        self._rows[0, self._end], self._rows[1, self._end] = setpoint, lag
        self._end += 1

    def at(self, heard_s: float) -> tuple[np.ndarray, np.ndarray]:
        """The setpoint in force at that time, or the first one, and the greatest lag from a little before on."""
        known = self._at_s[: self._end]
        setpoint = self._rows[0, max(int(known.searchsorted(heard_s, "right")) - 1, 0)]
        since = int(known.searchsorted(heard_s - _MEMORY_S))
        return setpoint, np.fmax.reduce(self._rows[1, since : self._end], axis=0, initial=0.0)


def _command(hand: Hand, name: str) -> str:
    found = match(name, hand.commands)
    if found is None:
        raise BadInput(f"gate.tracking: no command '{name}'", todo=nearest(name, hand.commands))
    return found
