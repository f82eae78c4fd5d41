"""The residual by what a joint was doing: holds, directions, speeds, reversals, travel."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from twin_daemon.simulation.alignment import Aligned

CONDITIONS = (
    "hold",
    "moving up",
    "moving down",
    "fast",
    "slow",
    "just after a reversal",
    "lower third of its travel",
    "middle third of its travel",
    "upper third of its travel",
)

_STILL_RAD_S = 0.05
_AFTER_REVERSAL_S = 0.25
_SMOOTH_S = 0.06
_LEAST_S = 0.2


@dataclass(frozen=True)
class ConditionError:
    """One joint's error under one condition, over all recordings.

    `times_average` is how much worse it is than the joint's own root mean square, `seconds` the time it rests on.
    The largest residual under it is at `worst_s` in recording number `worst_in`.
    """

    joint: str
    condition: str
    rmse_rad: float
    bias_rad: float
    times_average: float
    seconds: float
    worst_in: int
    worst_s: float


def errors_by_condition(predictions: Iterable[tuple[Aligned, np.ndarray]]) -> list[ConditionError]:
    """Every moving joint under every condition that lasts 0.2 s or more, worst first.

    Takes recordings with the predictions (n, j) rad of them.
    """
    collected: dict[str, list[_Part]] = {}
    for number, (recording, predicted) in enumerate(predictions):
        for column, joint in enumerate(recording.joints):
            if recording.moving[column]:
                part = _part(number, recording, column, predicted[:, column])
                collected.setdefault(joint, []).append(part)
    rows = []
    for joint, parts in collected.items():
        whole = np.concatenate([part.residual for part in parts])
        rms = float(np.sqrt(np.mean(whole**2)))
        rows += [row for name in CONDITIONS if rms > 0 and (row := _error(joint, name, parts, rms)) is not None]
    return sorted(rows, key=lambda row: -row.rmse_rad)


@dataclass(frozen=True)
class _Part:
    """The known samples of one joint in one recording."""

    number: int
    time_s: np.ndarray
    residual: np.ndarray
    masks: dict[str, np.ndarray]
    period_s: float


def _part(number: int, recording: Aligned, column: int, predicted: np.ndarray) -> _Part:
    measured = recording.measured[:, column]
    known = np.isfinite(measured)
    masks = conditions(recording.time_s, measured)
    return _Part(
        number,
        recording.time_s[known],
        (measured - predicted)[known],
        {name: mask[known] for name, mask in masks.items()},
        float(np.median(np.diff(recording.time_s))),
    )


def _error(joint: str, condition: str, parts: list[_Part], rms: float) -> ConditionError | None:
    chosen = [part.residual[part.masks[condition]] for part in parts]
    seconds = sum(len(residual) * part.period_s for residual, part in zip(chosen, parts, strict=True))
    if seconds <= _LEAST_S:
        return None
    together = np.concatenate(chosen)
    value = float(np.sqrt(np.mean(together**2)))
    peaks = [np.abs(residual).max() if residual.size else -1.0 for residual in chosen]
    worst = parts[int(np.argmax(peaks))]
    at = int(np.argmax(np.where(worst.masks[condition], np.abs(worst.residual), -1.0)))
    return ConditionError(
        joint=joint,
        condition=condition,
        rmse_rad=value,
        bias_rad=float(np.mean(together)),
        times_average=value / rms,
        seconds=float(seconds),
        worst_in=worst.number,
        worst_s=float(worst.time_s[at]),
    )


def smooth_speed(time_s: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Speed (n,) rad/s of one joint from its readings (n,) rad, smoothed over about an eighth of a second."""
    from scipy.ndimage import uniform_filter1d  # a daemon starts without it, a quarter of a second earlier

    known = np.isfinite(position)
    filled = np.interp(time_s, time_s[known], position[known])
    width = max(1, int(_SMOOTH_S / max(float(np.median(np.diff(time_s))), 1e-6)))
    return np.gradient(uniform_filter1d(filled, 2 * width + 1, mode="nearest"), time_s)


def directions(speed: np.ndarray) -> np.ndarray:
    """+1, 0 or -1 (n,): up, holding, down."""
    return np.where(np.abs(speed) > _STILL_RAD_S, np.sign(speed), 0.0)


def conditions(time_s: np.ndarray, position: np.ndarray) -> dict[str, np.ndarray]:
    """What one joint was doing at each sample, as masks (n,), in the order of CONDITIONS."""
    known = np.isfinite(position)
    filled = np.interp(time_s, time_s[known], position[known])
    speed = smooth_speed(time_s, position)
    direction = directions(speed)
    moving = direction != 0
    fast = np.abs(speed) > np.median(np.abs(speed[moving])) if moving.any() else moving
    underway = np.flatnonzero(moving)
    turns = time_s[underway[1:][np.diff(direction[underway]) != 0]]
    after = np.zeros(len(time_s), bool)
    if turns.size:
        latest = np.searchsorted(turns, time_s, side="right") - 1
        after = (latest >= 0) & (time_s < turns[np.maximum(latest, 0)] + _AFTER_REVERSAL_S)
    low, high = np.quantile(filled, [0.0, 1.0])
    third = (high - low) / 3.0
    masks = (
        ~moving,
        direction > 0,
        direction < 0,
        moving & fast,
        moving & ~fast,
        after,
        filled < low + third,
        (filled >= low + third) & (filled < high - third),
        filled >= high - third,
    )
    return dict(zip(CONDITIONS, masks, strict=True))
