"""How well data determine a value: its 95 % interval and a plain word for it; and the interval of a gain."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from twin_daemon.estimation.estimate import Estimate, Identifiability
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.solvers.least_squares import jacobian
from twin_daemon.estimation.solvers.tracker import Tracker
from twin_daemon.estimation.thresholds import (
    BLOCK_S,
    BOX_INFORMATION,
    CONFUSED_CORRELATION,
    EXPECTED_CORRELATION_S,
    IDENTIFIABLE_SHARE,
    RELATIVE_FLOOR,
    WEAK_SHARE,
    Z95,
)
from twin_daemon.estimation.variables import Variable

_BOX_SIGMA = 1.0 / np.sqrt(BOX_INFORMATION)  # of a uniform belief over the unit box


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


def estimates(
    problem: Problem, point: np.ndarray, *, error_floor_rad: float = 0.0, expected: bool = False
) -> list[Estimate]:
    """As `joint_estimates`, each value on its own."""
    return joint_estimates(problem, point, error_floor_rad=error_floor_rad, expected=expected)[0]


def joint_estimates(
    problem: Problem, point: np.ndarray, *, error_floor_rad: float = 0.0, expected: bool = False
) -> tuple[list[Estimate], np.ndarray]:
    """(the values at a point (p,) with Gauss-Newton intervals, widened by the residual's correlation; the correlations
    (p, p) of the values with each other).

    `error_floor_rad` is the least error to reckon with. With `expected` nothing has been fitted yet: the
    residual says nothing, and the floor with a typical correlation stands for it. What the data do not say is
    limited by the box of the search, and called not identifiable.
    """
    said = information_by_recording(problem, point, error_floor_rad=error_floor_rad, expected=expected)
    information = np.sum(said, axis=0)
    information += np.eye(len(point)) / _BOX_SIGMA**2
    covariance = np.linalg.inv(information)
    sigma = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(sigma, sigma)
    return [_estimate(problem, point, sigma, correlation, index) for index in range(len(point))], correlation


def information_by_recording(
    problem: Problem, point: np.ndarray, *, error_floor_rad: float = 0.0, expected: bool = False
) -> list[np.ndarray]:
    """(p, p) what each recording of a problem says of the unit coordinates at a point (p,): Gauss-Newton.

    As for `joint_estimates`; what is known without any recording, the box of the search, is not in it.
    """
    residuals = problem.joint_residuals(point[None])
    derivative = jacobian(Tracker(problem), point, problem.residuals(point[None])[0])
    # joint by joint: its residual's spread and correlation say how much its samples are worth
    found = []
    offset = 0
    per_joint = problem.samples_per_joint
    for recording, residual in zip(problem.recordings, residuals, strict=True):
        information = np.zeros((len(point), len(point)))
        expected_tau = max(1.0, EXPECTED_CORRELATION_S / float(np.median(np.diff(recording.time_s))))
        samples, joints = residual.shape[1:]
        rows = derivative[offset : offset + samples * joints].reshape(samples, joints, -1)
        offset += samples * joints
        for joint in range(joints):
            series = residual[0, :, joint]
            tau = expected_tau if expected else correlation_time(series)
            variance = error_floor_rad**2 if expected else max(float(np.mean(series**2)), error_floor_rad**2)
            unscaled = rows[:, joint] * np.sqrt(per_joint[joint] * joints)
            information += unscaled.T @ unscaled / (variance * tau)
        found.append(information)
    return found


def estimated(
    variable: Variable,
    value: float,
    ci95: tuple[float, float],
    identifiable: Identifiability | None = None,
    confused_with: str | None = None,
) -> Estimate:
    """A variable's value with its interval, beside the bounds that the variable has."""
    return Estimate(
        value=value,
        unit=variable.unit,
        ci95=ci95,
        lower=variable.lower,
        upper=variable.upper,
        at_bound=variable.at_bound(value),
        identifiable=identifiable,
        confused_with=confused_with,
    )


def _estimate(problem: Problem, point: np.ndarray, sigma: np.ndarray, correlation: np.ndarray, index: int) -> Estimate:
    variable = problem.variables[index]
    value = variable.value(point[index])
    lower, upper = _within(variable, point[index], sigma[index])
    least = RELATIVE_FLOOR * abs(value)
    lower, upper = min(lower, value - least), max(upper, value + least)
    share = sigma[index] / _BOX_SIGMA
    word = _in_a_word(float(share))
    partner = None
    others = np.abs(correlation[index])
    others[index] = 0.0
    if word != "identifiable" and others.size > 1 and others.max() > CONFUSED_CORRELATION:
        partner = problem.variables[int(np.argmax(others))].name
    return estimated(variable, value, (float(lower), float(upper)), word, partner)


def _in_a_word(share: float) -> Identifiability:
    if share < IDENTIFIABLE_SHARE:
        return "identifiable"
    return "weak" if share < WEAK_SHARE else "not_identifiable"


def _within(variable: Variable, unit: float, sigma: float) -> tuple[float, float]:
    """The values 1.96 sigma of a unit coordinate to either side, within the bounds."""
    half = Z95 * sigma
    return variable.value(max(unit - half, 0.0)), variable.value(min(unit + half, 1.0))


def widened(variable: Variable, unit: float, sigma: float, least: float) -> tuple[float, float]:
    """95 % interval of a value from the sigma of its unit coordinate, and beside that at least so much, in its unit."""
    low, high = _within(variable, unit, sigma)
    value = variable.value(unit)
    half = np.hypot(np.array([value - low, high - value]), least)
    return value - float(half[0]), value + float(half[1])


def inflation(times_floor: float, samples: float, fitted: int) -> float:
    """How many times more than the noise of the floor makes it the variance of fitted values is.

    What a fit leaves above the floor is no noise but what is wrong with the form of the model, and does not average out
    over the independent `samples`. A residual that has nothing to do with what a value does to the motion lies as much
    in that direction as in any other; directions that matter there are as many as `fitted` values.
    """
    left = max(times_floor - 1.0, 0.0)
    return 1.0 + left * (1.0 + samples / max(fitted, 1))


def unit_covariance(slopes: np.ndarray, believed: np.ndarray, inflated: float) -> np.ndarray:
    """(p, p) covariance of the unit coordinates by Gauss-Newton.

    `slopes` (m, p) are of the rows in standard deviations of the floor, whose variance is `inflated`, and `believed`
    (q, p) those of the priors.
    """
    information = slopes.T @ slopes / inflated + believed.T @ believed + BOX_INFORMATION * np.eye(slopes.shape[1])
    return np.linalg.inv(information)


def sample_squares(residuals: Sequence[np.ndarray], known: Sequence[np.ndarray]) -> np.ndarray:
    """(n,) rad^2: mean over the joints of each sample's squared error, over all recordings.

    Both are (n, k) a recording, 0 where a joint was not measured; samples at which nothing was measured are left out.
    """
    return np.concatenate([(r**2).mean(axis=1)[k.any(axis=1)] for r, k in zip(residuals, known, strict=True)])


def block_samples(time_s: np.ndarray) -> int:
    """How many samples of a recording at times (n,) s are one block of a bootstrap."""
    return max(1, int(BLOCK_S / float(np.median(np.diff(time_s)))))


def block_gain(before: np.ndarray, after: np.ndarray, block: int, seed: int, draws: int = 400) -> tuple[float, float]:
    """95 % interval of 1 - after/before by a bootstrap over blocks in time of squared errors (n,) each."""
    blocks = max(2, len(before) // max(block, 1))
    sums_before = np.array([part.sum() for part in np.array_split(before, blocks)])
    sums_after = np.array([part.sum() for part in np.array_split(after, blocks)])
    chosen = np.random.default_rng(seed).integers(0, blocks, (draws, blocks))
    total = np.maximum(sums_before[chosen].sum(axis=1), 1e-30)
    gains = 1.0 - sums_after[chosen].sum(axis=1) / total
    low, high = np.quantile(gains, [0.025, 0.975])
    return float(low), float(high)


def elsewhere(information: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """(p, p) what is known of values from where they were, by that information (p, p), where they may differ.

    `apart` (p,) is one sigma of that difference: the covariances add.
    """
    variance = np.square(apart)
    return np.linalg.solve(np.eye(len(apart)) + information * variance, information) if variance.any() else information


def conditional_information(slopes: np.ndarray, kept: Sequence[int]) -> np.ndarray:
    """(k, k) what rows with derivative (m, p) say of some of the variables, the others being unknown (Schur)."""
    information = slopes.T @ slopes
    others = [index for index in range(len(information)) if index not in set(kept)]
    found = information[np.ix_(kept, kept)]
    if others:
        cross = information[np.ix_(kept, others)]
        found = found - cross @ np.linalg.pinv(information[np.ix_(others, others)]) @ cross.T
    return found
