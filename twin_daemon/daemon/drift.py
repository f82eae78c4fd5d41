"""Does the hand drift away from its twin? A sequential test of each joint's error against what it was.

Wear, a slack tendon and a dead sensor make the residual larger for good; a fast motion does so for a moment. So time
is counted at each pace of the model on its own: ten seconds at one pace are a block, whose error is compared with that
of earlier blocks at the same pace, and what exceeds it adds up (see `cusum`). A joint that something has touched since
the model last started from the measurement is left out until it starts again: two fingers that hook onto each other, or
just miss, part ways for good, and that is chaos, not wear.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from twin_daemon.daemon.cusum import Cusum, threshold_for
from twin_daemon.daemon.messages import number

BLOCK_S = 10.0
SLACK = 0.5  # of a sigma: half the change that is to be noticed first
_BASELINE_BLOCKS = 24
_PACES_RAD_S = np.array([0.02, 0.2, 0.6])  # bounds between a joint at rest, slow, usual and fast
_LEAST_SIGMA = 0.3  # of the logarithm of a mean square: warm or cold, no hand repeats itself better
_LEAST_RAD = 1e-3  # added to every error: below it nothing is worth an alarm
_LONGEST_S = 0.1  # that one sample may stand for
_DAY_S = 86_400.0
_FORGET = 0.7  # of the recent error, at each new block

# A baseline of few blocks is itself uncertain: it is taken at the upper end of its 95 % interval.
_MEAN_REACH = 2.0 / np.sqrt(_BASELINE_BLOCKS)
_SIGMA_REACH = 1.0 + 2.0 / np.sqrt(2.0 * (_BASELINE_BLOCKS - 1))


@dataclass(frozen=True)
class Alarm:
    """A joint whose error has become larger for good: rms in rad before and in the last minute, and since when."""

    joint: str
    since_ns: int
    baseline_rmse_rad: float
    recent_rmse_rad: float


class Drift:
    """Watches the residual of each joint where the model runs free and follows commands.

    `false_alarms_per_day` is for the whole hand. The baseline is this version's first minutes at each pace.
    """

    def __init__(self, joints: tuple[str, ...], false_alarms_per_day: float = 1 / 30) -> None:
        self._joints = joints
        self._threshold = threshold_for(_DAY_S / BLOCK_S * len(joints) / false_alarms_per_day, SLACK)
        self._rate = false_alarms_per_day
        self.clear()

    def clear(self) -> None:
        """Begins anew, as for another version of the model."""
        shape = (len(_PACES_RAD_S) + 1, len(self._joints))
        self._seconds, self._squares = np.zeros(shape), np.zeros(shape)
        self._begun_ns = np.zeros(shape, dtype=np.int64)
        self._learnt = np.zeros(shape, dtype=int)
        self._mean, self._spread = np.zeros(shape), np.zeros(shape)
        self._test = Cusum(len(self._joints), SLACK, self._threshold)
        self._alarms: dict[str, Alarm] = {}
        self._baseline, self._recent = np.zeros((2, shape[1])), np.zeros((2, shape[1]))
        self._touched_s = np.zeros(shape[1])
        self._last_ns: int | None = None

    def add(self, stamp_ns: int, residual_rad: np.ndarray, speed_rad_s: np.ndarray, touched: np.ndarray) -> list[Alarm]:
        """Takes one residual (j,), NaN where a joint was not measured, the model's speeds (j,) and what was touched.

        Returns the alarms that it raises; a joint raises one, until `clear`.
        """
        last, self._last_ns = self._last_ns, stamp_ns
        if last is None or stamp_ns <= last:
            return []
        elapsed_s = min((stamp_ns - last) * 1e-9, _LONGEST_S)
        self._touched_s += elapsed_s * touched
        known = (np.isfinite(residual_rad) & ~touched).nonzero()[0]
        error_rad = residual_rad[known]
        pace = _PACES_RAD_S.searchsorted(np.abs(speed_rad_s[known]))
        cell = pace * len(self._joints) + known  # of the flat tables: at every sample, two indices cost twice as much
        before_s = self._seconds.take(cell)
        if not before_s.all():
            self._begun_ns.put(cell[before_s == 0.0], stamp_ns)
        seconds = before_s + elapsed_s
        self._seconds.put(cell, seconds)
        self._squares.put(cell, self._squares.take(cell) + elapsed_s * error_rad**2)
        full = seconds >= BLOCK_S
        return self._judge(pace[full], known[full]) if full.any() else []

    def _judge(self, pace: np.ndarray, joint: np.ndarray) -> list[Alarm]:
        """Closes the blocks of some joints (b,) at a pace each."""
        seconds, squares = self._seconds[pace, joint], self._squares[pace, joint]
        begun_ns = self._begun_ns[pace, joint]
        self._seconds[pace, joint] = self._squares[pace, joint] = 0.0
        log_power = np.log(squares / seconds + _LEAST_RAD**2)
        learning = self._learnt[pace, joint] < _BASELINE_BLOCKS
        sums = np.stack([seconds, squares])
        self._baseline[:, joint[learning]] += sums[:, learning]
        self._recent[:, joint] = _FORGET * self._recent[:, joint] + sums
        self._learn(pace[learning], joint[learning], log_power[learning])
        deviation = np.full(len(self._joints), np.nan)
        sigma = _SIGMA_REACH * np.sqrt(self._spread[pace, joint] / (_BASELINE_BLOCKS - 1))
        sigma = np.maximum(sigma, _LEAST_SIGMA)
        usual = self._mean[pace, joint] + _MEAN_REACH * sigma
        deviation[joint] = np.where(learning, np.nan, (log_power - usual) / sigma)
        since = np.zeros(len(self._joints), dtype=np.int64)
        since[joint] = begun_ns
        above = self._test.add(since, deviation)
        return [self._raise(int(index)) for index in np.flatnonzero(above) if self._joints[index] not in self._alarms]

    def _learn(self, pace: np.ndarray, joint: np.ndarray, log_power: np.ndarray) -> None:
        """Running mean and squares about it (Welford 1962) of each joint at its pace."""
        self._learnt[pace, joint] += 1
        step = log_power - self._mean[pace, joint]
        self._mean[pace, joint] += step / self._learnt[pace, joint]
        self._spread[pace, joint] += step * (log_power - self._mean[pace, joint])

    def _raise(self, index: int) -> Alarm:
        before, now = (float(_rms(sums)[index]) for sums in (self._baseline, self._recent))
        alarm = Alarm(self._joints[index], int(self._test.since_ns[index]), before, now)
        self._alarms[alarm.joint] = alarm
        return alarm

    @property
    def alarms(self) -> list[Alarm]:
        """Every joint that has alarmed since this version began, in that order."""
        return list(self._alarms.values())

    def as_json(self) -> dict[str, Any]:
        """Verdict `learning` (no full baseline yet), `steady` or `drifting`, with both errors of each joint."""
        ready = np.any(self._learnt >= _BASELINE_BLOCKS, axis=0)
        baseline, recent = _rms(self._baseline), _rms(self._recent)
        ratio = np.divide(recent, baseline, out=np.full_like(recent, np.nan), where=baseline > 0.0)
        drifting = list(self._alarms)
        return {
            "verdict": "drifting" if drifting else ("steady" if ready.any() else "learning"),
            "drifting_joints": drifting,
            "false_alarms_per_day": self._rate,
            "threshold": self._threshold,
            "block_s": BLOCK_S,
            "baseline_blocks": _BASELINE_BLOCKS,
            "joints": {
                name: {
                    "baseline_rmse_rad": number(baseline[i]),
                    "recent_rmse_rad": number(recent[i]),
                    "ratio": number(ratio[i]),
                    "statistic": number(self._test.sums[i]),
                    "learnt": bool(ready[i]),
                    "touched_s": number(self._touched_s[i]),
                    "since_ns": self._alarms[name].since_ns if name in self._alarms else None,
                }
                for i, name in enumerate(self._joints)
            },
        }


def _rms(sums: np.ndarray) -> np.ndarray:
    """Seconds and sums of squares (2, j) -> root mean square (j,), NaN where nothing was counted."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(sums[1] / sums[0])
