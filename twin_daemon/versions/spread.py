"""How much the values of a hand differ from session to session without wear, learnt from its own versions.

A value in the middle of three is compared with the straight line through the others, so that steady wear is in none of
it. What is left is the intervals' noise and the spread, one for all values of the hand, or it is a change, as after a
repair.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np
from scipy.stats import norm

from twin_daemon.versions.history import Point, measured_points
from twin_daemon.versions.store import VersionStore
from twin_daemon.versions.trend import USUAL_SPREAD, Z95

_FACTOR = 2.0  # about the usual spread, one sigma of the belief before any version speaks
_LEAST = 1.0 / 3.0  # of the usual: a fit that starts from the last version is more like it than two sessions are
_MOST = 5.0  # of the usual
_CHANGES = 0.1  # probability that one of three has changed
_CHANGE = 0.5  # of the logarithm, one sigma of a change
_GRID = 121  # points between these, evenly on a logarithmic scale


def spread_between_sessions(store: VersionStore) -> float | None:
    """Of a value, one sigma; None where no value was fitted in three promoted versions."""
    series = [points for name, points in measured_points(store).items() if ":" not in name]
    return learnt_spread(series)


def learnt_spread(series: Iterable[Sequence[Point]]) -> float | None:
    """The same from the fitted points of each value, oldest first; values that are not positive are left out."""
    found = [one for points in series for one in _off_the_line(points)]
    if not found:
        return None
    off, lever, noise = np.array(found).T
    spreads = USUAL_SPREAD * np.geomspace(_LEAST, _MOST, _GRID)
    scale = np.sqrt(spreads[:, None] ** 2 * lever + noise)
    same = np.log1p(-_CHANGES) + norm.logpdf(off, scale=scale)
    said = np.logaddexp(same, np.log(_CHANGES) + norm.logpdf(off, scale=np.hypot(scale, _CHANGE)))
    believed = -0.5 * (np.log(spreads / USUAL_SPREAD) / np.log(_FACTOR)) ** 2
    return float(spreads[np.argmax(said.sum(axis=1) + believed)])


def _off_the_line(points: Sequence[Point]) -> Iterator[tuple[float, float, float]]:
    """(how far off in the logarithm, the share of the spread's variance in it, the intervals' variance) of points."""
    usable = [p for p in points if p.ci95 is not None and p.value > 0.0 and p.ci95[0] > 0.0]
    logs = [float(np.log(p.value)) for p in usable]
    variances = [(float(np.log(p.ci95[1] / p.ci95[0])) / (2.0 * Z95)) ** 2 for p in usable if p.ci95 is not None]
    for i in range(1, len(usable) - 1):
        whole = (usable[i + 1].at - usable[i - 1].at).total_seconds()
        if whole <= 0.0:
            continue
        later = (usable[i].at - usable[i - 1].at).total_seconds() / whole
        shares = np.array([-(1.0 - later), 1.0, -later])
        around = slice(i - 1, i + 2)
        yield float(shares @ logs[around]), float(shares @ shares), float(shares**2 @ variances[around])
