"""Where a model fails: the residual by joint and by what the joint was doing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.twin import TwinModel

_STILL_RAD_S = 0.05
_AFTER_REVERSAL_S = 0.25
_WORST = 12


def where_it_fails(twin: TwinModel, recordings: Sequence[Aligned]) -> list[dict[str, Any]]:
    """Joints and conditions with the largest errors, worst first.

    Each has the joint, the condition in words, its root mean square error (rad), how much worse that is than the
    joint's own average, and how many seconds of motion it rests on.
    """
    rows: list[dict[str, Any]] = []
    collected: dict[str, list[tuple[np.ndarray, dict[str, np.ndarray], float]]] = {}
    for recording in recordings:
        residual = recording.measured - predict(twin, recording)
        period = float(np.median(np.diff(recording.time_s)))
        for column, joint in enumerate(recording.joints):
            if recording.moving[column]:
                known = np.isfinite(residual[:, column])
                masks = conditions(recording.time_s, recording.measured[:, column])
                collected.setdefault(joint, []).append(
                    (residual[known, column], {name: mask[known] for name, mask in masks.items()}, period)
                )
    for joint, items in collected.items():
        whole = np.concatenate([residual for residual, _, _ in items])
        rms = float(np.sqrt(np.mean(whole**2)))
        for name in items[0][1]:
            chosen = np.concatenate([residual[masks[name]] for residual, masks, _ in items])
            seconds = sum(float(masks[name].sum()) * period for _, masks, period in items)
            if seconds > 0.2 and rms > 0:
                value = float(np.sqrt(np.mean(chosen**2)))
                rows.append(
                    {
                        "joint": joint,
                        "condition": name,
                        "rmse_rad": value,
                        "bias_rad": float(np.mean(chosen)),
                        "times_average": value / rms,
                        "seconds": seconds,
                    }
                )
    return sorted(rows, key=lambda row: -row["rmse_rad"])[:_WORST]


def conditions(time_s: np.ndarray, position: np.ndarray) -> dict[str, np.ndarray]:
    """What one joint was doing at each sample, as masks (n,): holds, directions, speeds, reversals, travel."""
    filled = np.interp(time_s, time_s[np.isfinite(position)], position[np.isfinite(position)])
    width = max(1, int(0.06 / max(float(np.median(np.diff(time_s))), 1e-6)))
    smooth = np.convolve(np.pad(filled, width, mode="edge"), np.ones(2 * width + 1) / (2 * width + 1), mode="valid")
    speed = np.gradient(smooth, time_s)
    moving = np.abs(speed) > _STILL_RAD_S
    fast = np.abs(speed) > np.median(np.abs(speed[moving])) if moving.any() else moving
    direction = np.where(moving, np.sign(speed), 0.0)
    last = np.zeros_like(direction)
    for index in range(1, len(direction)):
        last[index] = direction[index - 1] if direction[index - 1] else last[index - 1]
    turns = time_s[(direction != 0) & (last != 0) & (direction != last)]
    after = np.zeros(len(time_s), bool)
    for turn in turns:
        after |= (time_s >= turn) & (time_s < turn + _AFTER_REVERSAL_S)
    low, high = np.quantile(filled, [0.0, 1.0])
    third = (high - low) / 3.0
    return {
        "hold": ~moving,
        "moving up": direction > 0,
        "moving down": direction < 0,
        "fast": moving & fast,
        "slow": moving & ~fast,
        "just after a reversal": after,
        "lower third of its travel": filled < low + third,
        "middle third of its travel": (filled >= low + third) & (filled < high - third),
        "upper third of its travel": filled >= high - third,
    }
