"""Whether the hand follows: how far it may lag behind its setpoints is what the twin lags behind the same setpoints."""

from __future__ import annotations

from collections import deque

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
        self._past: deque[tuple[float, np.ndarray, np.ndarray]] = deque()
        self.forget()

    def forget(self) -> None:
        """A new motion begins at rest."""
        self._past.clear()
        self._off_s = np.full(len(self.names), np.nan)  # arrival of the first measurement that was off
        self._away = np.zeros(len(self.names))
        self._allowed = np.zeros(len(self.names))

    @property
    def off(self) -> bool:
        """Whether any command is off at the moment."""
        return bool(np.isfinite(self._off_s).any())

    def sent(self, now_s: float, setpoint: np.ndarray, expected: np.ndarray) -> None:
        """The setpoints in force from now on, and where the twin is."""
        self._past.append((now_s, setpoint, np.abs(setpoint - expected)))
        while self._past[0][0] < now_s - 4.0 * _MEMORY_S:
            self._past.popleft()

    def look(self, measured: np.ndarray, arrival_s: np.ndarray) -> tuple[str, str] | None:
        """The command that has been off for too long, if one has, and what a trip says of it."""
        if not self._past:
            return None
        heard_s = float(arrival_s.max())
        before = [entry for entry in self._past if entry[0] <= heard_s] or [self._past[0]]
        setpoint = before[-1][1]
        lags = np.array([lag for at_s, _, lag in self._past if at_s >= heard_s - _MEMORY_S])
        lag = np.fmax.reduce(lags, axis=0, initial=0.0)
        self._allowed = np.minimum(self._ratio * lag + self.floor, self._most_rad)
        self._away = np.abs(setpoint - measured)
        off = self._away > self._allowed
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


def _command(hand: Hand, name: str) -> str:
    found = match(name, hand.commands)
    if found is None:
        raise BadInput(f"gate.tracking: no command '{name}'", todo=nearest(name, hand.commands))
    return found
