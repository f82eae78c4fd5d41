"""How well the data determine each knob: 95 % intervals and a plain word."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin_daemon.fitting.problem import Problem
from twin_daemon.fitting.searches.least_squares import jacobian
from twin_daemon.fitting.tracker import Tracker

Identifiability = Literal["identifiable", "weak", "not_identifiable"]

_BOX_SIGMA = 1.0 / np.sqrt(12.0)  # of a uniform belief over the unit box
_RELATIVE_FLOOR = 0.01  # of the value: models are never better than that (measured coverage says so)


@dataclass(frozen=True)
class Interval:
    """A 95 % interval in the knob's unit. `confused_with` is the knob that it trades off with, if any."""

    lower: float
    upper: float
    identifiability: Identifiability
    confused_with: str | None


def correlation_time(residual: np.ndarray) -> float:
    """Samples per independent sample of one residual series (n,): 1 + 2 sum of its autocorrelation.

    Summed up to its first zero crossing (Geyer 1992, initial positive sequence).
    """
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * centred.size)) ** 2
    correlation = np.fft.irfft(power)[: centred.size]
    if correlation[0] <= 0:
        return 1.0
    correlation = correlation / correlation[0]
    negative = np.flatnonzero(correlation <= 0)
    last = negative[0] if negative.size else centred.size
    return float(max(1.0, 1.0 + 2.0 * correlation[1:last].sum()))


_EXPECTED_CORRELATION_S = 0.1  # of a fitted hand's residual, for data that have not been fitted yet


def intervals(
    problem: Problem, point: np.ndarray, *, error_floor_rad: float = 0.0, expected: bool = False
) -> list[Interval]:
    """Gauss-Newton intervals at a point (p,), widened by the residual's correlation.

    `error_floor_rad` is the least error to reckon with. With `expected` nothing has been fitted yet: the
    residual says nothing, and the floor with a typical correlation stands for it. What the data do not say is
    limited by the box of the search, and called not identifiable.
    """
    derivative = jacobian(Tracker(problem), point)
    # joint by joint: its residual's spread and correlation say how much its samples are worth
    information = np.zeros((len(point), len(point)))
    offset = 0
    per_joint = problem.samples_per_joint
    for recording, residual in zip(problem.recordings, problem.joint_residuals(point[None]), strict=True):
        expected_tau = max(1.0, _EXPECTED_CORRELATION_S / float(np.median(np.diff(recording.time_s))))
        samples, joints = residual.shape[1:]
        rows = derivative[offset : offset + samples * joints].reshape(samples, joints, -1)
        offset += samples * joints
        for joint in range(joints):
            series = residual[0, :, joint]
            tau = expected_tau if expected else correlation_time(series)
            variance = error_floor_rad**2 if expected else max(float(np.mean(series**2)), error_floor_rad**2)
            unscaled = rows[:, joint] * np.sqrt(per_joint[joint] * joints)
            information += unscaled.T @ unscaled / (variance * tau)
    information += np.eye(len(point)) / _BOX_SIGMA**2
    covariance = np.linalg.inv(information)
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return [_interval(problem, point, sigma, correlation, index) for index in range(len(point))]


def _interval(problem: Problem, point: np.ndarray, sigma: np.ndarray, correlation: np.ndarray, index: int) -> Interval:
    knob = problem.knobs[index]
    value = knob.value(point[index])
    half = 1.96 * sigma[index]
    lower, upper = knob.value(max(point[index] - half, 0.0)), knob.value(min(point[index] + half, 1.0))
    least = _RELATIVE_FLOOR * abs(value)
    lower, upper = min(lower, value - least), max(upper, value + least)
    share = sigma[index] / _BOX_SIGMA
    word: Identifiability = "identifiable" if share < 0.1 else "weak" if share < 0.5 else "not_identifiable"
    partner = None
    others = np.abs(correlation[index])
    others[index] = 0.0
    if word != "identifiable" and others.size > 1 and others.max() > 0.9:
        partner = problem.knobs[int(np.argmax(others))].name
    return Interval(float(lower), float(upper), word, partner)
