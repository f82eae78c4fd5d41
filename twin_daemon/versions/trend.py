"""Where is a quantity heading, and when will it leave its band? A state-space model of values with intervals.

A level that grows at a rate, wanders (a random walk), may change its rate (an integrated one) and may jump; each look
at it is off by its own interval and by what sessions differ anyway. How much it wanders and sessions differ is averaged
over, by restricted likelihood; the spread between these answers is part of every interval (Hoeting and others 1999).
The answer is the Kalman smoother's (Durbin and Koopman 2012), computed at once for all times by Cholesky: looks are
tens and come at odd times, and level and growth at the start are unknown, which a filter has to be told by large
numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Literal

import numpy as np
from scipy.linalg import cho_solve
from scipy.special import ndtr

Z95 = 1.959963984540054
_SAME = 1e-12  # of the value: an interval narrower than this says nothing about the weight
USUAL_SPREAD = 0.03  # of a value, between sessions without wear, until there are three
_SPREADS = (0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)  # of what a straight line leaves
_WALKS = {0.0: 0.91, 0.25: 0.03, 0.5: 0.03, 1.0: 0.03}  # of that, between two looks: how probable each is beforehand
_TURNS = {0.0: 0.94, 3.0: 0.03, 10.0: 0.03}  # of that over the time watched: by how much its rate changes in all
_JUMP = 0.5  # of the value: size of a jump, one sigma
_COVARIATE = 0.5  # of the value, by one standard deviation of the covariate
_NAMED_NATS = 3.0  # that a jump has to bring beyond the price of all weeks it could have been in
_MOST_JUMPS = 3
_LEAST_FOR_A_JUMP = 5
_DRAWS = 500
_HORIZON_DAYS = 20.0 * 365.25  # what is later is not said
_COUNTS = 1e-3  # of all weight: an answer with less is left out
_DIFFER = 2.0  # of the intervals' sigma: looks that are farther off a line than this differ by more than their noise
_FALSE = 0.01  # probability that an unworn hand's history shows any trend, over all values that are looked at
_BACK = 0.5  # of what had gathered: a jump that leaves less is a repair

Verdict = Literal["rising", "falling", "no_trend", "too_few"]


@dataclass(frozen=True)
class Sample:
    """A value at a time (days since any moment) with its 95 % interval; None where it is unknown.

    `covariate` is what else acted on it then, such as a temperature; all samples have one or none has.
    """

    day: float
    value: float
    ci95: tuple[float, float] | None
    covariate: float | None = None


@dataclass(frozen=True)
class Leaving:
    """When it crosses a bound of the band if it goes on, in days; infinite where it may never do so in twenty years."""

    bound: Literal["lower", "upper"]
    value: float
    day: float
    earliest_day: float
    latest_day: float


@dataclass(frozen=True)
class Jump:
    """A step between two looks, at `day` the later one; `is_repair` where it takes most of what had gathered away."""

    day: float
    before_day: float
    size: float
    ci95: tuple[float, float]
    is_repair: bool


@dataclass(frozen=True)
class Trend:
    """`slope_per_day` is the growth at the last look with its 95 % interval; None where there are too few values.

    A trend: the growth is so far from 0 that among all values that are looked at hardly one would be by chance.
    `band` is (day, level, its interval) at each look, without the covariate's part.
    `wanders` says that the level goes up and down by itself, or that looks differ by more than their intervals:
    temperature, load, or wear and care, which the values alone cannot tell apart.
    """

    verdict: Verdict
    samples: int
    slope_per_day: float | None = None
    slope_ci95: tuple[float, float] | None = None
    level: float | None = None  # at `day`
    day: float | None = None
    band: tuple[tuple[float, float, tuple[float, float]], ...] = ()
    jumps: tuple[Jump, ...] = ()
    wanders: bool = False
    covariate_effect: tuple[float, tuple[float, float]] | None = None  # by one unit of it, with its interval
    paths: tuple[tuple[float, float], ...] = ()  # draws of (level at `day`, growth a day)


@dataclass(frozen=True)
class _Answer:
    """Of one setting of the unknown spreads: mean (m,) and covariance of levels, growth, steps, covariate."""

    mean: np.ndarray
    covariance: np.ndarray
    wanders: bool


def fit_trend(samples: Sequence[Sample], among: int = 1) -> Trend:
    """The model fitted to the samples that have an interval; to all, with equal weights, where none has one.

    Two samples need intervals, more do not: their scatter then says how sure the answer is. `among` is how many
    values of the hand are looked at: of a hundred 95 % intervals of what does not grow five leave 0 out, and one of
    them called wear would be a false alarm on every hand (Bonferroni's bound).
    """
    weighted = [s for s in samples if s.ci95 is not None]
    known = len(weighted) >= 2
    used = sorted(weighted if known else samples, key=lambda s: s.day)
    days = np.array([s.day for s in used])
    if len(used) < (2 if known else 3) or np.ptp(days) == 0.0:
        return Trend("too_few", len(used))
    series = _Series(used, known)
    jumps = series.jumps()
    answers, weights = series.answers(jumps)
    return series.told(jumps, answers, weights, 1.0 - _FALSE / max(among, 1))


def _half(off: np.ndarray, sigmas: np.ndarray, weights: np.ndarray, held: float = 0.95) -> float:
    """Half of the interval about the mean that holds this share of a mixture of normal distributions (a,)."""
    low, high = 0.0, float((np.abs(off) + 8.0 * sigmas).max())
    if high == 0.0:
        return 0.0
    spread = np.maximum(sigmas, 1e-12 * high)
    for _ in range(40):
        middle = 0.5 * (low + high)
        inside = weights @ (ndtr((middle - off) / spread) - ndtr((-middle - off) / spread))
        low, high = (middle, high) if inside < held else (low, middle)
    return high


def _root(covariance: np.ndarray) -> np.ndarray:
    """(2, 2) A with A A^T a covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


class _Series:
    """Looks at one quantity, on a scale on which what a straight line leaves is about 1."""

    def __init__(self, used: Sequence[Sample], known: bool) -> None:
        self.days = np.array([s.day for s in used])
        self.values = np.array([s.value for s in used])
        self.sigmas = _sigmas(used) if known else np.zeros(len(used))
        given = [s.covariate for s in used if s.covariate is not None]
        self.covariate = np.array(given) if len(given) == len(used) and np.ptp(given) > 0.0 else None
        self.size = max(float(np.median(np.abs(self.values))), float(np.ptp(self.values)), 1e-300)
        n = len(used)
        known_of = [np.ones(n), self.days - self.days.mean()]
        if self.covariate is not None and n > 3:
            known_of.append(self.covariate - self.covariate.mean())
        shape = np.stack(known_of, axis=1)
        left = self.values - shape @ np.linalg.lstsq(shape, self.values, rcond=None)[0]
        self.left = max(float(np.sqrt((left**2).sum() / max(n - shape.shape[1], 1))), _SAME * self.size)
        least = _SAME * self.size
        self.spreads = (
            (USUAL_SPREAD * float(np.median(np.abs(self.values))),)
            if n < 3
            else tuple(share * self.left for share in ((0.0, *_SPREADS) if known else _SPREADS))
        )
        self.sigmas = np.maximum(self.sigmas, least)
        typical = float(np.sqrt(np.mean(self.sigmas**2)))
        self._differ = known and n >= _LEAST_FOR_A_JUMP and self.left > _DIFFER * typical
        self.fixed = np.stack([np.ones(n), self.days - self.days[-1]], axis=1)
        t = self.days - self.days[0]
        low, high = np.minimum(t[:, None], t[None]), np.maximum(t[:, None], t[None])
        self._wandering = (
            self.left**2 * (n - 1) / t[-1] * low,
            (self.left / t[-1]) ** 2 / t[-1] * low**2 * (3.0 * high - low) / 6.0,
        )
        """(n, n) each: what a walk of 1 and a turn of 1 do to the levels."""

    def jumps(self) -> list[int]:
        """Looks before which there was a step, by index, the most probable ones first."""
        found: list[int] = []
        n = len(self.days)
        if n < _LEAST_FOR_A_JUMP:
            return found
        places = [i for i in range(1, n) if self.days[i] > self.days[i - 1]]
        has = self._evidence(found)
        while len(found) < _MOST_JUMPS:
            tried = {i: self._evidence([*found, i]) for i in places if i not in found}
            best = max(tried, key=lambda i: tried[i], default=None)
            if best is None or tried[best] - has - np.log(len(places)) < _NAMED_NATS:
                break
            found.append(best)
            has = tried[best]
        return found

    def _evidence(self, jumps: Sequence[int]) -> float:
        """Log likelihood averaged over the spreads; of walks a few."""
        settings = [(spread, walk, 0.0) for spread, walk in product(self.spreads, (0.0, 0.5))]
        prior = self._prior(settings)
        return float(np.logaddexp.reduce(self._log_likelihoods(jumps, settings) + prior))

    def answers(self, jumps: Sequence[int]) -> tuple[list[_Answer], np.ndarray]:
        """The answers of every setting that counts, with their weights (a,)."""
        few = len(self.days) < _LEAST_FOR_A_JUMP
        settings = list(product(self.spreads, (0.0,) if few else _WALKS, (0.0,) if few else _TURNS))
        log = self._log_likelihoods(jumps, settings) + self._prior(settings)
        weights = np.exp(log - log.max())
        kept = np.flatnonzero(weights > _COUNTS * weights.sum())
        return [self._answer(jumps, *settings[i]) for i in kept], weights[kept] / weights[kept].sum()

    def _prior(self, settings: Sequence[tuple[float, float, float]]) -> np.ndarray:
        """(s,) log probability of settings beforehand; as likely as not, sessions differ by their intervals alone."""
        alone = {0.0: float(len(_SPREADS))}
        return np.log([alone.get(spread, 1.0) * _WALKS[walk] * _TURNS[turn] for spread, walk, turn in settings])

    def _log_likelihoods(self, jumps: Sequence[int], settings: Sequence[tuple[float, float, float]]) -> np.ndarray:
        """(s,) restricted log likelihoods of settings."""
        spread, walk, turn = np.array(settings).T[:, :, None, None]
        one, two = self._wandering
        rest = self._stepping(jumps)[0] + np.diag(self.sigmas**2)
        values = walk**2 * one + turn**2 * two + spread**2 * np.eye(len(self.days)) + rest
        factor = np.linalg.cholesky(values)
        inner = np.linalg.solve(factor, np.column_stack([self.fixed, self.values])[None])
        shape, value = inner[:, :, :2], inner[:, :, 2:]
        normal = shape.transpose(0, 2, 1) @ shape
        cross = shape.transpose(0, 2, 1) @ value
        explained = (cross.transpose(0, 2, 1) @ np.linalg.solve(normal, cross))[:, 0, 0]
        fit = (value**2).sum(axis=(1, 2)) - explained
        spans = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        return -spans - 0.5 * np.linalg.slogdet(normal)[1] - 0.5 * fit

    # -- one setting ---------------------------------------------------------------------------------------

    def _stepping(self, jumps: Sequence[int]) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """((n, n) of the values by steps and covariate, (k, n) of steps with levels, (n,) of the covariate's part)."""
        after = np.array([self.days >= self.days[i] for i in jumps], dtype=float).reshape(-1, len(self.days))
        steps = (_JUMP * self.size) ** 2 * after
        values = after.T @ steps
        if self.covariate is None:
            return values, steps, None
        centred = (self.covariate - self.covariate.mean()) / self.covariate.std()
        sway = (_COVARIATE * self.size) ** 2 * centred
        return values + np.outer(centred, sway), steps, sway / self.covariate.std()

    def _answer(self, jumps: Sequence[int], spread: float, walk: float, turn: float) -> _Answer:
        """Mean and covariance of the levels, of the growth at the end, of steps and of the covariate's part."""
        n, t = len(self.days), self.days - self.days[0]
        values, steps, sway = self._stepping(jumps)
        after = (steps > 0.0).astype(float)
        wanders = walk**2 * self._wandering[0] + turn**2 * self._wandering[1]
        level = wanders + after.T @ steps
        values = values + wanders + np.diag(self.sigmas**2 + spread**2)
        growth = 0.5 * turn**2 * (self.left / t[-1]) ** 2 / t[-1] * t**2
        rows = np.concatenate([level, growth[None], steps, *([sway[None]] if sway is not None else [])])
        prior = np.zeros((len(rows), len(rows)))
        prior[:, :n], prior[:n, :] = rows, rows.T
        prior[:n, :n] = level
        prior[n, n] = (turn * self.left / t[-1]) ** 2
        k = len(jumps)
        prior[n + 1 : n + 1 + k, n + 1 : n + 1 + k] = (_JUMP * self.size) ** 2 * np.eye(k)
        if sway is not None and self.covariate is not None:
            prior[-1, :n] = prior[:n, -1] = 0.0  # levels are without it
            prior[-1, -1] = (_COVARIATE * self.size / self.covariate.std()) ** 2
        factor = np.linalg.cholesky(values)
        solved = cho_solve((factor, True), np.column_stack([self.fixed, self.values]))
        inverse = np.linalg.inv(self.fixed.T @ solved[:, :2])
        fixed = inverse @ (self.fixed.T @ solved[:, 2])
        shape = np.zeros((len(rows), 2))
        shape[:n], shape[n] = self.fixed, (0.0, 1.0)
        half = cho_solve((factor, True), rows.T)
        unknown = shape - half.T @ self.fixed
        covariance = prior - rows @ half + unknown @ inverse @ unknown.T
        mean = shape @ fixed + rows @ (solved[:, 2] - solved[:, :2] @ fixed)
        return _Answer(mean, 0.5 * (covariance + covariance.T), walk > 0.0 or turn > 0.0)

    # -- in words ------------------------------------------------------------------------------------------

    def told(self, jumps: Sequence[int], answers: Sequence[_Answer], weights: np.ndarray, sure: float) -> Trend:
        """Means and 95 % intervals of the mixture of all answers; a trend is one that the `sure` interval has, too."""
        n, k = len(self.days), len(jumps)
        means = np.array([one.mean for one in answers])
        sigmas = np.sqrt(np.maximum([np.diag(one.covariance) for one in answers], 0.0))
        mean = weights @ means
        half = np.array([_half(means[:, i] - mean[i], sigmas[:, i], weights) for i in range(len(mean))])
        slope, ends = float(mean[n]), (float(mean[n] - half[n]), float(mean[n] + half[n]))
        certain = abs(slope) > _half(means[:, n] - slope, sigmas[:, n], weights, sure)
        verdict: Verdict = ("rising" if slope > 0.0 else "falling") if certain else "no_trend"
        rng = np.random.default_rng(0)
        end = np.ix_([n - 1, n], [n - 1, n])
        drawn = np.concatenate(
            [
                one.mean[[n - 1, n]] + rng.standard_normal((round(_DRAWS * w), 2)) @ _root(one.covariance[end]).T
                for one, w in zip(answers, weights, strict=True)
            ]
        )
        wanders = sum(w for w, one in zip(weights, answers, strict=True) if one.wanders)
        effect = None
        if self.covariate is not None:
            effect = (float(mean[-1]), (float(mean[-1] - half[-1]), float(mean[-1] + half[-1])))
        return Trend(
            verdict=verdict,
            samples=n,
            slope_per_day=slope,
            slope_ci95=ends,
            level=float(mean[n - 1]),
            day=float(self.days[-1]),
            band=tuple(
                (float(d), float(m), (float(m - h), float(m + h)))
                for d, m, h in zip(self.days, mean[:n], half[:n], strict=True)
            ),
            jumps=tuple(
                sorted(
                    (self._jump(i, mean, float(mean[n + 1 + j]), float(half[n + 1 + j])) for j, i in enumerate(jumps)),
                    key=lambda one: one.day,
                )
            )
            if k
            else (),
            wanders=bool(wanders > 0.5) or self._differ,
            covariate_effect=effect,
            paths=tuple((float(a), float(b)) for a, b in drawn),
        )

    def _jump(self, index: int, mean: np.ndarray, size: float, half: float) -> Jump:
        gathered = mean[index - 1] - mean[0]
        left = mean[index] - mean[0]
        repaired = gathered * size < 0.0 and abs(left) < _BACK * abs(gathered) and abs(gathered) > half
        days = self.days
        return Jump(float(days[index]), float(days[index - 1]), size, (size - half, size + half), bool(repaired))


def leaving(trend: Trend, band: tuple[float | None, float | None], today: float) -> Leaving | None:
    """When it leaves the band (lower, upper) if it goes on; None without a trend or without that bound.

    What is outside already leaves today.
    """
    if trend.verdict not in ("rising", "falling"):
        return None
    side: Literal["lower", "upper"] = "upper" if trend.verdict == "rising" else "lower"
    bound = band[1] if side == "upper" else band[0]
    if bound is None or trend.level is None or trend.day is None or not trend.slope_per_day:
        return None
    paths = np.array([(trend.level, trend.slope_per_day), *trend.paths])
    towards = paths[:, 1] * np.sign(trend.slope_per_day)
    away = (bound - paths[:, 0]) * np.sign(trend.slope_per_day)
    with np.errstate(divide="ignore", invalid="ignore"):
        later = np.where(away <= 0.0, 0.0, np.where(towards > 0.0, away / towards, np.inf))
    days = np.maximum(trend.day + later, today)
    days[days > today + _HORIZON_DAYS] = np.inf
    early, late = np.quantile(days[1:], [0.025, 0.975], method="nearest") if len(days) > 1 else (days[0], days[0])
    return Leaving(side, bound, float(days[0]), float(min(early, days[0])), float(max(late, days[0])))


def _sigmas(samples: Sequence[Sample]) -> np.ndarray:
    """Standard deviations (n,); an interval of no width counts as the narrowest that has one."""
    sigma = np.array([(s.ci95[1] - s.ci95[0]) / (2 * Z95) if s.ci95 else 0.0 for s in samples])
    floor = _SAME * max(1.0, max(abs(s.value) for s in samples))
    real = sigma[sigma > floor]
    return np.maximum(sigma, real.min() if real.size else 1.0)
