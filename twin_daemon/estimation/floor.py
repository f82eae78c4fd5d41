"""What sensors leave of a right model: their noise and resolution, and the jitter of stamps."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.estimation.thresholds import LEAST_NOISE_RAD, SPEED_SAMPLES
from twin_daemon.recordings.noise import noise_variance, resolution
from twin_daemon.simulation.alignment import Aligned


def floor_variance(recordings: Sequence[Aligned], joints: Sequence[str]) -> np.ndarray:
    """(k,) rad^2: each joint's sensor noise and resolution, and what the jitter of stamps makes of its speed."""
    noise, jitter = [], []
    for joint in joints:
        columns = [(r.time_s, r.measured[:, r.joints.index(joint)], r.time_sigma_s) for r in recordings]
        noise.append(_reading_variance([values for _, values, _ in columns]))
        # of the fastest piece no less than its share: a mean of squares is what it is compared with
        samples = [len(time_s) for time_s, _, _ in columns]
        jitter.append(float(np.average([_jitter_variance(*column) for column in columns], weights=samples)))
    return np.maximum(np.add(noise, jitter), LEAST_NOISE_RAD**2)


def _reading_variance(pieces: Sequence[np.ndarray]) -> float:
    """rad^2: noise and resolution of a sensor, from its readings (n,) in each piece.

    A piece in which a coarse sensor rests on one count says nothing of either, so that the counts of all are compared.
    """
    known = [values[np.isfinite(values)] for values in pieces]
    count = resolution(np.concatenate(known))
    telling = [values for values in known if values.size and values.min() < values.max()] or known
    return max(float(np.median([noise_variance(values) for values in telling])), count**2 / 12.0)


def _jitter_variance(time_s: np.ndarray, values: np.ndarray, time_sigma_s: float | None) -> float:
    """rad^2: the variance of a sample's time times the mean squared speed.

    Where the readings do not tell it, it is that of the stamps about a regular clock.
    """
    if len(time_s) < 4 * SPEED_SAMPLES:
        return 0.0
    index = np.arange(len(time_s))
    clock = np.polyval(np.polyfit(index, time_s, 1), index)
    # a difference of two stamps has twice the variance of one
    jitter = np.diff(time_s - clock).var() / 2.0 if time_sigma_s is None else time_sigma_s**2
    speed = (values[2 * SPEED_SAMPLES :] - values[: -2 * SPEED_SAMPLES]) / np.maximum(
        time_s[2 * SPEED_SAMPLES :] - time_s[: -2 * SPEED_SAMPLES], 1e-9
    )
    speed = speed[np.isfinite(speed)]
    return float(jitter * (speed**2).mean()) if speed.size else 0.0
