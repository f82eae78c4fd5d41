"""Whether what a hand says of its joints can be: within its reach, and no faster than a hand moves."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import Hand

RECENT_S = 0.1
_LASTS_S = 0.5  # a reading that could not be is remembered for so long
_SHORTEST_S = 0.02  # messages that waited arrive together
_NOISE = 6.0  # standard deviations


@dataclass(frozen=True)
class Doubt:
    """A reading that cannot be."""

    joint: str
    why: str
    until_s: float


class Readings:
    """Judges positions (j,) rad as they arrive, and remembers those of the last `RECENT_S`.

    One thread gives, any may ask: what is asked for is replaced as a whole.
    """

    def __init__(self, hand: Hand, joints: tuple[str, ...], settings: GateSettings) -> None:
        self._joints = joints
        info = [hand.description.joints[joint] for joint in joints]
        ranges = np.array([hand.joint_range_rad.get(joint, (-np.inf, np.inf)) for joint in joints]).reshape(-1, 2)
        self._range = ranges
        tolerance = np.array([one.range_tolerance_rad for one in info])
        self._low, self._high = ranges[:, 0] - tolerance, ranges[:, 1] + tolerance
        self._fastest = settings.implausible_speed * np.array([one.velocity_limit for one in info])
        self._blur = np.array([_NOISE * one.noise_rad + one.resolution_rad for one in info])
        self._recent: deque[tuple[float, np.ndarray]] = deque()
        self._doubts: dict[str, Doubt] = {}

    def take(self, position: np.ndarray, arrival_s: np.ndarray) -> None:
        """Positions (j,) with their arrivals (j,), s; NaN where nothing is known."""
        now_s = float(arrival_s.max(initial=-np.inf))
        with np.errstate(invalid="ignore"):
            outside = (position < self._low) | (position > self._high)
        found: list[Doubt] = []
        if outside.any():
            found += [self._outside(i, float(position[i]), now_s) for i in np.flatnonzero(outside).tolist()]
        if self._recent:
            # the last one, for a jump, and the oldest one, for what is too fast in steps that are small
            for at_s, before in {id(entry): entry for entry in (self._recent[-1], self._recent[0])}.values():
                since_s = max(now_s - at_s, _SHORTEST_S)
                with np.errstate(invalid="ignore"):
                    fast = np.abs(position - before) > self._fastest * since_s + self._blur
                if fast.any():
                    found += [self._fast(i, position, before, since_s, now_s) for i in np.flatnonzero(fast).tolist()]
        while self._recent and self._recent[0][0] < now_s - RECENT_S:
            self._recent.popleft()
        self._recent.append((now_s, position.copy()))
        if found:
            self._doubts = self._doubts | {doubt.joint: doubt for doubt in reversed(found)}

    def doubts(self, now_s: float) -> list[Doubt]:
        """What could not be, of the last moments."""
        if not self._doubts:
            return []
        return [doubt for doubt in self._doubts.values() if doubt.until_s > now_s]

    def recent(self, now_s: float) -> np.ndarray:
        """(n, j) rad: the readings of the last `RECENT_S`, the very last at least; none before the first."""
        entries = list(self._recent)
        kept = [position for at_s, position in entries if at_s >= now_s - RECENT_S] or [p for _, p in entries[-1:]]
        return np.array(kept).reshape(len(kept), len(self._joints))

    def _outside(self, i: int, value: float, now_s: float) -> Doubt:
        low, high = self._range[i]
        return Doubt(
            self._joints[i],
            f"{self._joints[i]} reads {value:.3f} rad, and its range is {low:.3f} to {high:.3f} rad: is its driver's"
            " unit rad, is its zero right?",
            now_s + _LASTS_S,
        )

    def _fast(self, i: int, position: np.ndarray, before: np.ndarray, since_s: float, now_s: float) -> Doubt:
        return Doubt(
            self._joints[i],
            f"{self._joints[i]} reads {position[i]:.3f} rad and read {before[i]:.3f} rad just before; no hand moves at"
            f" {abs(position[i] - before[i]) / since_s:.0f} rad/s",
            now_s + _LASTS_S,
        )
