"""Is a quantity drifting, and when will it leave its band? A straight line through values with intervals.

Weighted least squares, weights from the 95 % intervals. Where the values scatter more than their intervals allow
(chi-square test at 5 %), the line's own interval is widened by that scatter (Birge ratio) with Student's t.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy import stats

_Z95 = 1.959963984540054
_CHI2_LEVEL = 0.95
_SAME = 1e-12  # of the value: an interval narrower than this says nothing about the weight

Verdict = Literal["rising", "falling", "no_trend", "too_few"]


@dataclass(frozen=True)
class Sample:
    """A value at a time (days since any moment) with its 95 % interval; None where it is unknown."""

    day: float
    value: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class Leaving:
    """When the line crosses a bound of the band, in days; `earliest` and `latest` by the slope's interval."""

    bound: Literal["lower", "upper"]
    value: float
    day: float
    earliest_day: float
    latest_day: float


@dataclass(frozen=True)
class Trend:
    """`slope_per_day` with its 95 % interval (None where there are too few values). No trend: the interval holds 0."""

    verdict: Verdict
    samples: int
    slope_per_day: float | None = None
    slope_ci95: tuple[float, float] | None = None
    level: float | None = None  # of the line at `day`
    day: float | None = None


def fit_trend(samples: Sequence[Sample]) -> Trend:
    """A line through the samples that have an interval; through all, with equal weights, where none has one.

    Two samples need intervals, more do not: their scatter then says how sure the line is.
    """
    weighted = [s for s in samples if s.ci95 is not None]
    known = len(weighted) >= 2
    used = weighted if known else list(samples)
    days = np.array([s.day for s in used])
    if len(used) < (2 if known else 3) or np.ptp(days) == 0.0:
        return Trend("too_few", len(used))
    values = np.array([s.value for s in used])
    sigma = _sigmas(used) if known else np.ones(len(used))
    weights = sigma**-2.0
    centre = float(np.average(days, weights=weights))
    level = float(np.average(values, weights=weights))
    spread = float(np.sum(weights * (days - centre) ** 2))
    slope = float(np.sum(weights * (days - centre) * (values - level)) / spread)
    half = _half_width(weights, values - level - slope * (days - centre), spread, known)
    verdict: Verdict = "no_trend" if abs(slope) <= half else "rising" if slope > 0 else "falling"
    return Trend(verdict, len(used), slope, (slope - half, slope + half), level, centre)


def leaving(trend: Trend, band: tuple[float | None, float | None], today: float) -> Leaving | None:
    """When the line leaves the band (lower, upper) if it goes on; None without a trend or without that bound.

    A line that is outside already leaves today.
    """
    if trend.verdict not in ("rising", "falling"):
        return None
    side: Literal["lower", "upper"] = "upper" if trend.verdict == "rising" else "lower"
    bound = band[1] if side == "upper" else band[0]
    if bound is None or trend.slope_ci95 is None or trend.level is None or trend.day is None or not trend.slope_per_day:
        return None
    distance = max((bound - trend.level) * np.sign(trend.slope_per_day), 0.0)
    slopes = (trend.slope_per_day, *trend.slope_ci95)
    day, *ends = (max(float(trend.day + distance / abs(slope)), today) for slope in slopes)
    return Leaving(bound=side, value=bound, day=day, earliest_day=min(ends), latest_day=max(ends))


def _sigmas(samples: Sequence[Sample]) -> np.ndarray:
    """Standard deviations (n,); an interval of no width counts as the narrowest that has one."""
    sigma = np.array([(s.ci95[1] - s.ci95[0]) / (2 * _Z95) if s.ci95 else 0.0 for s in samples])
    floor = _SAME * max(1.0, max(abs(s.value) for s in samples))
    real = sigma[sigma > floor]
    return np.maximum(sigma, real.min() if real.size else 1.0)


def _half_width(weights: np.ndarray, residual: np.ndarray, spread: float, known: bool) -> float:
    """Half of the slope's 95 % interval."""
    freedom = len(residual) - 2
    chi2 = float(np.sum(weights * residual**2))
    if known and (freedom == 0 or chi2 <= stats.chi2.ppf(_CHI2_LEVEL, freedom)):
        return _Z95 / np.sqrt(spread)
    return float(stats.t.ppf(0.975, freedom) * np.sqrt(chi2 / freedom / spread))
