"""When readings were taken: at their stamps, or on the clock of a controller whose stamps come late by chance.

A stamp that is a millisecond off makes an error of a millirad of a joint that moves with 1 rad/s. Whether it is the
stamp that is off the clock, or the reading that was taken then, the readings themselves say: taken at the right times
a motion is smooth. What is left of it by a difference of fourth order is noise, but for the speed times the error of
the times; the share of the stamps' offsets that is found in there is what the readings follow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin_daemon.recordings.noise import noise_variance

_ORDER = 4  # of the difference that nothing of a smooth motion is left of
_AROUND = 50  # samples to either side that any clock runs evenly over
_CHANCE = 2.0  # times what independent offsets give, of a mean of squares of a few dozen
_JITTER = 0.3  # of a period: stamps that are further off keep no clock
_COUNTED_S = 1e-9  # what stamps count in: what they are off by less is their rounding
_BESIDE = 10  # samples that say whether a long interval is a missing sample or a late stamp
_SPEED_S = 0.01  # over which a speed is read, but over no fewer than three samples
_SPEED_KNOWN = 0.02  # of the squared speed may be the sensor's noise, which makes any share look smaller
_KNOWN_TO = 0.1  # sigma of a share that counts
_BLOCK, _BLOCKS = 500, 100  # samples in which most moves, that a long recording is judged by
_LAGS = _ORDER + 1  # over which what is left repeats itself, being a difference


@dataclass(frozen=True)
class SampleTimes:
    """`time_s` (n,) of readings on the stamps' clock, and `sigma_s`, how well each is known; None where it is not."""

    time_s: np.ndarray
    sigma_s: float | None


def sample_times(stamp_s: np.ndarray, position: np.ndarray) -> SampleTimes:
    """When the readings (n, j) rad or m with increasing stamps (n,) s were taken.

    The stamps themselves where they keep no clock, or where too little moves to tell.
    """
    as_stamped = SampleTimes(stamp_s, None)
    if len(stamp_s) <= 2 * _AROUND:
        return as_stamped
    number = _numbered(stamp_s)
    offset, averaged = _off_the_clock(stamp_s, number)
    jitter = float(offset.std())
    if not _COUNTED_S < jitter < _JITTER * float(np.median(np.diff(stamp_s))):
        return as_stamped
    share, sigma = _share(stamp_s - offset, number, offset, position)
    if not sigma < _KNOWN_TO:
        return as_stamped
    share = float(np.clip(share, 0.0, 1.0))
    # where both are off, each by its own chance, the share says nothing of a single one; and the clock is a mean
    unknown = share * (1.0 - share) + sigma**2 + (1.0 - share) ** 2 / averaged
    time_s = stamp_s - (1.0 - share) * offset
    return as_stamped if (np.diff(time_s) <= 0.0).any() else SampleTimes(time_s, jitter * float(np.sqrt(unknown)))


def _numbered(stamp_s: np.ndarray) -> np.ndarray:
    """(n,) which sample of the clock each one is: a long interval with all later stamps as late is a missing one."""
    period, count = float(np.median(np.diff(stamp_s))), len(stamp_s)
    steps = np.ones(count - 1, int)
    gap = np.flatnonzero(np.diff(stamp_s) > 1.5 * period)
    later, next_one = stamp_s - period * np.arange(count), gap + 1
    before = _means(later, np.maximum(next_one - _BESIDE, 0), next_one)
    after = _means(later, next_one, np.minimum(next_one + _BESIDE, count))
    steps[gap] += np.maximum(np.rint((after - before) / period).astype(int), 0)
    return np.concatenate([[0], np.cumsum(steps)])


def _off_the_clock(stamp_s: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, float]:
    """((n,) s by which stamps are later than the clock, how many stamps each of its times is a mean of).

    The clock runs evenly for as long as that leaves nothing but chance in means over a hundred stamps.
    """
    later = stamp_s - np.polyval(np.polyfit(number, stamp_s, 1), number)
    offset, averaged = later, 0.5 * len(later)  # a line has two numbers
    half = len(later) // 4
    while half >= _AROUND and not _only_chance(offset):
        around = np.arange(len(later))
        begin, end = np.maximum(around - half, 0), np.minimum(around + half + 1, len(later))
        offset, averaged = later - _means(later, begin, end), 2.0 * half + 1.0
        half //= 2
    return offset, averaged


def _only_chance(offset: np.ndarray) -> bool:
    """Whether means of offsets (n,) over a hundred vary as those of independent ones do."""
    means = offset[: len(offset) // (2 * _AROUND) * 2 * _AROUND].reshape(-1, 2 * _AROUND).mean(axis=1)
    return float(np.mean(means**2)) < _CHANCE * float(offset.var()) / (2 * _AROUND)


def _means(values: np.ndarray, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(m,) the means of values (n,) from each `begin` (m,) up to its `end` (m,)."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    return (total[end] - total[begin]) / (end - begin)


def _share(clock_s: np.ndarray, number: np.ndarray, offset: np.ndarray, position: np.ndarray) -> tuple[float, float]:
    """(share of the stamps' offsets that the readings follow, its sigma): least squares over all joints that move."""
    period = float(np.median(np.diff(clock_s)))
    half = int(np.clip(round(0.5 * _SPEED_S / period), 1, _AROUND // 2))
    steps = np.arange(-half, half + 1.0)  # the slope of a line, or of a parabola, through so many samples
    told: list[tuple[np.ndarray, np.ndarray]] = []
    for block in _moving_most(position):
        inner = slice(block.start + half, block.stop - half)
        steady = (np.lib.stride_tricks.sliding_window_view(np.diff(number[inner]), _ORDER) == 1).all(axis=1)
        for values in position[block].T:
            if not np.isfinite(values).all():
                continue
            slopes = np.correlate(values, steps, "valid") / (float(steps @ steps) * period)
            of_noise = noise_variance(values) / (float(steps @ steps) * period**2)
            if of_noise > _SPEED_KNOWN * float(np.mean(slopes**2)):
                continue
            pair = values[half:-half], offset[inner] * slopes
            seen, asked = (np.diff(one, n=_ORDER)[steady] for one in pair)
            scale = float(np.std(seen)) or 1.0
            told.append((asked / scale, seen / scale))
    information = sum(float(asked @ asked) for asked, _ in told)
    if information <= 0.0:
        return 1.0, np.inf
    share = sum(float(asked @ seen) for asked, seen in told) / information
    variance = sum(_repeated(asked * (seen - share * asked)) for asked, seen in told)
    return share, float(np.sqrt(max(variance, 0.0))) / information


def _repeated(scores: np.ndarray) -> float:
    """The variance of a sum of scores (m,) that resemble those just before them (Newey and West 1987)."""
    lags = [(1.0 - lag / (_LAGS + 1.0)) * float(scores[lag:] @ scores[:-lag]) for lag in range(1, _LAGS + 1)]
    return float(scores @ scores) + 2.0 * sum(lags)


def _moving_most(position: np.ndarray) -> list[slice]:
    """All of a short recording; of a long one the blocks of samples in which most moves."""
    if len(position) <= _BLOCK * _BLOCKS:
        return [slice(0, len(position))]
    blocks = [slice(begin, begin + _BLOCK) for begin in range(0, len(position) - _BLOCK + 1, _BLOCK)]
    moves = [float(np.nansum(np.diff(position[block][::10], axis=0) ** 2)) for block in blocks]
    return [blocks[i] for i in sorted(np.argsort(moves)[-_BLOCKS:])]
