"""Whether a refitted twin is better: on motion it has not seen, for every joint, and by numbers that can exist."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from twin_daemon.estimation.uncertainty import Estimate, block_gain, block_samples
from twin_daemon.recalibration.clear_errors import clear_residuals
from twin_daemon.recordings.noise import noise_variance
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel

_NOISES = 3.0  # a joint may get worse by so many variances of its sensor's noise
_MOVED = 0.01  # a value that was on its bound and stays there has not been driven to it


@dataclass(frozen=True)
class Decision:
    """`better` is whether to promote; `against` says what speaks against it, in words.

    `gain` is the part of the held-out mean squared error that has gone, with its 95 % interval (bootstrap over blocks).
    """

    better: bool
    gain: float
    gain_ci95: tuple[float, float]
    before_rad2: float
    after_rad2: float
    worse: tuple[str, ...]
    against: tuple[str, ...]


def decide(
    before: TwinModel,
    after: TwinModel,
    held: Sequence[Aligned],
    parameters: Mapping[str, Estimate],
    started: Mapping[str, float],
    seed: int = 0,
) -> Decision:
    """Compares two twins on held-out recordings. `started` are the parameters' values before the fit."""
    old, new, joints, noise = _squared(before, after, held)
    block = block_samples(held[0].time_s)
    overall = np.nanmean(old, axis=1), np.nanmean(new, axis=1)
    low, high = block_gain(*overall, block, seed)
    worse = []
    for column, name in enumerate(joints):
        known = np.isfinite(old[:, column])
        if not known.any():
            continue
        was, now = old[known, column], new[known, column]
        if now.mean() > was.mean() + _NOISES * noise[column] and block_gain(was, now, block, seed)[1] < 0.0:
            worse.append(name)
    bound = [name for name, p in parameters.items() if p.at_bound and _moved(p, started.get(name, np.nan))]
    against = []
    if low <= 0.0:
        against.append(f"the gain on held-out motion may be none: {low:.0%} to {high:.0%}")
    if worse:
        against.append(f"worse beyond noise: {', '.join(worse)}")
    if bound:
        against.append(f"driven to a bound: {', '.join(bound)}")
    return Decision(
        better=not against,
        gain=1.0 - float(overall[1].mean() / max(overall[0].mean(), 1e-30)),
        gain_ci95=(low, high),
        before_rad2=float(overall[0].mean()),
        after_rad2=float(overall[1].mean()),
        worse=tuple(worse),
        against=tuple(against),
    )


def _moved(one: Estimate, started: float) -> bool:
    """Whether a value has come from elsewhere in its range."""
    width = np.inf if one.upper is None or one.lower is None else one.upper - one.lower
    return abs(one.value - started) > _MOVED * width


def _squared(
    before: TwinModel, after: TwinModel, held: Sequence[Aligned]
) -> tuple[np.ndarray, np.ndarray, list[str], np.ndarray]:
    """Squared errors (n, k) rad^2 of both twins over the joints that move, their names and noise variances (k,)."""
    residuals = clear_residuals((before, after), held)
    moving = np.any([r.moving for r in held], axis=0)
    names = [name for name, moves in zip(held[0].joints, moving, strict=True) if moves]
    old, new = (np.concatenate([each[which][:, moving] ** 2 for each in residuals]) for which in range(2))
    seen = np.isfinite(old).any(axis=1)
    noise = [noise_variance(column) if np.isfinite(column).any() else 0.0 for column in held[0].measured.T[moving]]
    return old[seen], new[seen], names, np.array(noise)
