"""Does the hand drift away from its twin? The error now against the error when this version began."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin_daemon.daemon.messages import number

_BLOCK_NS = 5_000_000_000
_BASELINE_BLOCKS = 12
_RECENT_BLOCKS = 12
_RATIO_THAT_MATTERS = 1.5
_FLOOR_RAD = 0.005


class Drift:
    """Compares the mean squared residual of the last minute with that of this version's first minute.

    Only samples where the model runs free and a command has been seen are given to it, so that a hand at rest
    before its first command does not set the baseline.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        self._joints = joints
        self.clear()

    def clear(self) -> None:
        """Begins anew, as for another version of the model."""
        count = len(self._joints)
        self._baseline: list[np.ndarray] = []
        self._recent: list[np.ndarray] = []
        self._sums = np.zeros((2, count))
        self._block_ns: int | None = None

    def add(self, stamp_ns: int, residual_rad: np.ndarray) -> None:
        """Takes one residual (j,); NaN where a joint was not measured."""
        if self._block_ns is None or stamp_ns < self._block_ns:
            self._block_ns = stamp_ns
        known = np.isfinite(residual_rad)
        self._sums += np.stack([known.astype(float), np.where(known, residual_rad, 0.0) ** 2])
        if stamp_ns - self._block_ns < _BLOCK_NS:
            return
        if len(self._baseline) < _BASELINE_BLOCKS:
            self._baseline.append(self._sums)
        self._recent = [*self._recent, self._sums][-_RECENT_BLOCKS:]
        self._sums = np.zeros_like(self._sums)
        self._block_ns = stamp_ns

    def as_json(self) -> dict[str, Any]:
        """Verdict `learning` (no full baseline yet), `steady` or `drifting`, with both errors of each joint."""
        baseline, recent = _rmse(self._baseline, len(self._joints)), _rmse(self._recent, len(self._joints))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = recent / baseline
            moved = (ratio > _RATIO_THAT_MATTERS) & (recent - baseline > _FLOOR_RAD)
        learning = len(self._baseline) < _BASELINE_BLOCKS
        drifting = [] if learning else [name for name, moves in zip(self._joints, moved, strict=True) if moves]
        seconds = _BLOCK_NS * 1e-9
        return {
            "verdict": "learning" if learning else ("drifting" if drifting else "steady"),
            "drifting_joints": drifting,
            "baseline_s": len(self._baseline) * seconds,
            "recent_s": len(self._recent) * seconds,
            "ratio_threshold": _RATIO_THAT_MATTERS,
            "joints": {
                name: {
                    "baseline_rmse_rad": number(baseline[i]),
                    "recent_rmse_rad": number(recent[i]),
                    "ratio": number(ratio[i]),
                }
                for i, name in enumerate(self._joints)
            },
        }


def _rmse(blocks: list[np.ndarray], joints: int) -> np.ndarray:
    total = np.sum(blocks, axis=0) if blocks else np.zeros((2, joints))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(total[1] / total[0])
