"""How sure a version is of its values, together: what it was fitted to says some, and its parent's history the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime

import numpy as np

from twin_daemon.estimation.estimate import Correlated
from twin_daemon.versions.trend import Z95
from twin_daemon.versions.version import ParameterRecord, PosteriorRecord, Version

_WIDENS = 0.01  # of a value, by the square root of a week: what nobody has looked at may have worn meanwhile
_WEEK_S = 7 * 86_400.0
_UNLIKE = 2.0  # sigma: a value that has left the earlier interval is another one


def posterior_of(version: Version, at: datetime | None = None) -> PosteriorRecord:
    """What a version knows, as of a time (UTC) if one is given: the longer ago, the wider.

    One that was stored before versions had a posterior gets one of its intervals, as if its values were independent.
    """
    found = version.posterior or _joined(version.parameters, (), None)
    if at is None or version.created is None:
        return found
    weeks = max((at - datetime.fromisoformat(version.created)).total_seconds(), 0.0) / _WEEK_S
    return widened(found, weeks)


def widened(posterior: PosteriorRecord, weeks: float) -> PosteriorRecord:
    """The same after so many weeks in which nobody has looked."""
    covariance = _matrix(posterior)
    grown = covariance + np.diag((_WIDENS * np.array(posterior.means)) ** 2 * weeks)
    return posterior.model_copy(update={"covariance": _rows(grown)})


def after_fit(
    parameters: Mapping[str, ParameterRecord], correlations: Sequence[Correlated], before: PosteriorRecord | None
) -> PosteriorRecord:
    """What a fit leaves known; `before` is as of now. What it could not see keeps its earlier mean and interval."""
    return _joined(parameters, correlations, before)


def intervals(posterior: PosteriorRecord) -> dict[str, ParameterRecord]:
    """Each value on its own, with its 95 % interval."""
    found = {}
    for i, (name, unit, mean) in enumerate(zip(posterior.names, posterior.units, posterior.means, strict=True)):
        half = Z95 * float(np.sqrt(posterior.covariance[i][i]))
        found[name] = ParameterRecord(value=mean, unit=unit, ci95=(mean - half, mean + half))
    return found


def _joined(
    parameters: Mapping[str, ParameterRecord], correlations: Sequence[Correlated], before: PosteriorRecord | None
) -> PosteriorRecord:
    old = {} if before is None else {name: i for i, name in enumerate(before.names)}
    new = {name: p for name, p in parameters.items() if p.value is not None and p.ci95 is not None}
    names = (*new, *(name for name in old if name not in new))
    means, sigmas, units, kept = np.zeros(len(names)), np.zeros(len(names)), [], []
    unseen: list[str] = []
    for i, name in enumerate(names):
        known = None
        if before is not None and name in old:
            place = old[name]
            known = before.means[place], float(np.sqrt(before.covariance[place][place])), before.units[place]
        one = new.get(name)
        if one is not None and one.value is not None and one.ci95 is not None:
            sigma = (one.ci95[1] - one.ci95[0]) / (2.0 * Z95)
            if one.identifiable in (False, "not_identifiable"):
                unseen.append(name)
            if known is None or sigma <= known[1] or abs(one.value - known[0]) > _UNLIKE * known[1]:
                means[i], sigmas[i] = one.value, sigma
                units.append(one.unit)
                continue
        assert known is not None
        if one is None:
            unseen.append(name)
        means[i], sigmas[i] = known[:2]
        units.append(known[2])
        kept.append(name)
    correlation = np.eye(len(names))
    index = {name: i for i, name in enumerate(names)}
    earlier = [] if before is None else [(before.names, _correlation(before))]
    for among, (of, matrix) in [
        *((set(kept), one) for one in earlier),
        *((set(new) - set(kept), c) for c in correlations),
    ]:
        chosen = [j for j, name in enumerate(of) if name in among]
        places = [index[of[j]] for j in chosen]
        correlation[np.ix_(places, places)] = np.asarray(matrix)[np.ix_(chosen, chosen)]
    np.fill_diagonal(correlation, 1.0)
    return PosteriorRecord(
        names=names,
        units=tuple(units),
        means=tuple(map(float, means)),
        covariance=_rows(correlation * np.outer(sigmas, sigmas)),
        not_excited=tuple(unseen),
    )


def _correlation(posterior: PosteriorRecord) -> np.ndarray:
    covariance = _matrix(posterior)
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return covariance / np.outer(sigma, sigma)


def _matrix(posterior: PosteriorRecord) -> np.ndarray:
    """(p, p) covariance; of a version without fitted values there is nothing in it."""
    count = len(posterior.names)
    return np.array(posterior.covariance, dtype=float).reshape(count, count)


def _rows(matrix: np.ndarray) -> tuple[tuple[float, ...], ...]:
    symmetric = 0.5 * (matrix + matrix.T)
    return tuple(tuple(map(float, row)) for row in symmetric)
