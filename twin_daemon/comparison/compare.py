"""The twin against the measurement: by joint, group and hand, beside reference predictors and the noise floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.minimum import lowest
from twin_daemon.recordings.noise import noise_variance
from twin_daemon.simulation.alignment import Aligned, command_onset, model_onset, predict
from twin_daemon.simulation.twin import TwinModel

_LAG_RANGE_S = 0.3
_LAG_SAMPLES = 6000  # that the first look for a lag takes of a long recording


@dataclass(frozen=True)
class JointError:
    """One joint's error. Positive bias: the joint reads more than predicted; positive lag: it comes later."""

    mse_rad2: float
    rmse_rad: float
    max_abs_rad: float
    bias_rad: float
    lag_s: float | None
    noise_rad2: float
    moves: bool


@dataclass(frozen=True)
class Comparison:
    """One recording against one twin. `predicted` and `aligned.measured` are (n, j) rad in `joints` order."""

    aligned: Aligned
    predicted: np.ndarray
    joints: dict[str, JointError]

    @property
    def residual(self) -> np.ndarray:
        """(n, j) rad: measured minus predicted."""
        return self.aligned.measured - self.predicted


def compare_recording(twin: TwinModel, aligned: Aligned, *, threads: int | None = None) -> Comparison:
    """Rolls the twin out under the recording's commands and judges it joint by joint.

    Where the recording does not hold its commands, the onset is chosen in the model's favour; the raw command,
    as a reference predictor, gets the same right.
    """
    if aligned.onset_free:
        aligned = aligned.with_onset(model_onset(twin, aligned, threads=threads))
    predicted = predict(twin, aligned, threads=threads)
    return Comparison(aligned, predicted, _joint_errors(aligned, predicted))


def shifted(found: Comparison, lag_s: float) -> Comparison:
    """The same comparison with what is predicted moved to later times."""
    time_s = found.aligned.time_s
    moved = [np.interp(time_s - lag_s, time_s, column) for column in found.predicted.T]
    predicted = np.column_stack(moved)
    return replace(found, predicted=predicted, joints=_joint_errors(found.aligned, predicted))


def common_lag(found: Comparison) -> float | None:
    """The shift of the prediction (s) that suits all moving joints best, each by how much it is off its own noise; None
    where none tells one."""
    lags = [
        (one.lag_s, one.mse_rad2 / max(one.noise_rad2, 1e-12))
        for one in found.joints.values()
        if one.moves and one.lag_s is not None
    ]
    if not lags:
        return None
    lags.sort()
    weight = np.cumsum([share for _, share in lags])
    return float(lags[int(np.searchsorted(weight, 0.5 * weight[-1]))][0])


def _joint_errors(aligned: Aligned, predicted: np.ndarray) -> dict[str, JointError]:
    moving = aligned.moving
    errors = {}
    for column, name in enumerate(aligned.joints):
        measured = aligned.measured[:, column]
        known = np.isfinite(measured)
        if not known.any():
            continue
        residual = measured[known] - predicted[known, column]
        mse = float(np.mean(residual**2))
        lag = _lag(aligned.time_s[known], measured[known], predicted[known, column]) if moving[column] else None
        errors[name] = JointError(
            mse_rad2=mse,
            rmse_rad=float(np.sqrt(mse)),
            max_abs_rad=float(np.max(np.abs(residual))),
            bias_rad=float(np.mean(residual)),
            lag_s=lag,
            noise_rad2=noise_variance(measured),
            moves=bool(moving[column]),
        )
    return errors


def _lag(time_s: np.ndarray, measured: np.ndarray, predicted: np.ndarray) -> float | None:
    """The shift of the prediction (s) that brings it closest to the measurement; None where none can be told."""
    if np.ptp(predicted) < 1e-3 or time_s[-1] < 2 * _LAG_RANGE_S:
        return None
    inner = np.flatnonzero((time_s >= _LAG_RANGE_S) & (time_s <= time_s[-1] - _LAG_RANGE_S))

    def error(lag: float, every: int = 1) -> float:
        at = inner[::every]
        gap = measured[at] - np.interp(time_s[at] - lag, time_s, predicted)
        return float(np.mean((gap - gap.mean()) ** 2))

    grid = np.linspace(-_LAG_RANGE_S, _LAG_RANGE_S, 61)
    every = int(np.ceil(len(inner) / _LAG_SAMPLES))
    best = float(grid[int(np.argmin([error(lag, every) for lag in grid]))])
    if abs(best) >= _LAG_RANGE_S:  # the best lies outside of what was looked at
        return None
    return lowest(error, best - 0.01, best + 0.01, 1e-5)


def raw_command(twin: TwinModel, aligned: Aligned) -> np.ndarray:
    """(n, j) rad: every joint where it was told to be; NaN for the joints that no command drives.

    The command may lag by whatever suits it best, so that it is not blamed for a servo's delay.
    """
    return commanded_joints(twin, aligned, command_onset(twin, aligned))


def commanded_joints(twin: TwinModel, aligned: Aligned, onset_s: float | None = None) -> np.ndarray:
    """(n, j) rad: where every joint was told to be, from `onset_s` on if that is given; NaN without a command.

    A tendon's command is split evenly over its joints, which is all that a command alone can say.
    """
    commanded = aligned.controls(twin, aligned.time_s, onset_s)  # (n, nu)
    split = np.linalg.pinv(twin.drive)  # (j, nu)
    return np.where(split.any(axis=1), commanded @ split.T, np.nan)


def raw_command_mse(twin: TwinModel, aligned: Aligned) -> dict[str, float]:
    """Mean squared error (rad^2) of the raw command by moving joint that a command drives."""
    predicted = raw_command(twin, aligned)
    return {
        name: float(np.nanmean((aligned.measured[:, i] - predicted[:, i]) ** 2))
        for i, name in enumerate(aligned.joints)
        if aligned.moving[i] and np.isfinite(predicted[:, i]).any()
    }


def raw_command_error(twin: TwinModel, recordings: Sequence[Aligned]) -> float | None:
    """The raw command's mean squared error (rad^2) over the moving joints of several recordings; None without any."""
    errors: dict[str, list[tuple[float, int]]] = {}
    for recording in recordings:
        for name, mse in raw_command_mse(twin, recording).items():
            errors.setdefault(name, []).append((mse, len(recording.time_s)))
    if not errors:
        return None
    means = [np.average([m for m, _ in pairs], weights=[n for _, n in pairs]) for pairs in errors.values()]
    return float(np.mean(means))


def pooled(comparisons: Sequence[Comparison]) -> dict[str, JointError]:
    """The joints of several recordings as one: means weighted by samples, the worst of the extremes."""
    names = list(dict.fromkeys(name for c in comparisons for name in c.joints))
    out = {}
    for name in names:
        having = [c for c in comparisons if name in c.joints]
        moving = [c for c in having if c.joints[name].moves] or having
        weights = np.array([len(c.aligned.time_s) for c in moving], float)
        parts = [c.joints[name] for c in moving]
        mse = float(np.average([p.mse_rad2 for p in parts], weights=weights))
        lags = [p.lag_s for p in parts if p.lag_s is not None]
        out[name] = JointError(
            mse_rad2=mse,
            rmse_rad=float(np.sqrt(mse)),
            max_abs_rad=max(p.max_abs_rad for p in parts),
            bias_rad=float(np.average([p.bias_rad for p in parts], weights=weights)),
            lag_s=float(np.median(lags)) if lags else None,
            noise_rad2=float(np.average([p.noise_rad2 for p in parts], weights=weights)),
            moves=any(p.moves for p in parts),
        )
    return out


def mean_over_moving(joints: Mapping[str, JointError], only: Sequence[str] | None = None) -> float | None:
    """Mean squared error (rad^2) over the joints that move, optionally of one group; None where none does."""
    values = [e.mse_rad2 for name, e in joints.items() if e.moves and (only is None or name in only)]
    return float(np.mean(values)) if values else None


def noise_floor(joints: Mapping[str, JointError]) -> float | None:
    """Mean noise variance (rad^2) over the joints that move: what would be left by a perfect model."""
    values = [e.noise_rad2 for e in joints.values() if e.moves]
    return float(np.mean(values)) if values else None
