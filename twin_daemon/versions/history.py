"""The history of a hand: what each parameter and each value of an effect was found to be, promotion by promotion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from twin_daemon.effects import LIBRARY
from twin_daemon.errors import BadInput, nearest
from twin_daemon.versions.decisions import Decision
from twin_daemon.versions.store import VersionStore
from twin_daemon.versions.trend import Leaving, Sample, Trend, fit_trend, leaving
from twin_daemon.versions.version import Version

_DAY_S = 86400.0


@dataclass(frozen=True)
class Promotion:
    """A version that became current and was not rolled back. `at` is UTC and never earlier than the one before.

    `exact` is False where only the time at which the version was made is known.
    """

    at: datetime
    version: Version
    exact: bool = True


@dataclass(frozen=True)
class Point:
    """One value of a series. `ci95` is None where it was carried over or set, not fitted."""

    at: datetime
    version: str
    value: float
    ci95: tuple[float, float] | None


@dataclass(frozen=True)
class LeavesBand:
    """When the trend leaves the band, if it goes on. A time is None where it is beyond every calendar."""

    bound: str
    value: float
    at: datetime | None
    earliest: datetime | None
    latest: datetime | None


@dataclass(frozen=True)
class Level:
    """Where the smoothed level is at a time, with its 95 % interval."""

    at: datetime
    value: float
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Step:
    """A jump between two looks at the hand, by `size` in the series' unit; a repair takes back most of what had
    gathered."""

    after: datetime | None
    until: datetime | None
    size: float
    ci95: tuple[float, float]
    is_repair: bool


@dataclass(frozen=True)
class Series:
    """A parameter or a value of an effect over time. `band` is (lower, upper) in `unit`; None where unknown."""

    name: str
    unit: str
    points: tuple[Point, ...]
    band: tuple[float | None, float | None]
    trend: Trend
    leaves_band: LeavesBand | None
    levels: tuple[Level, ...] = ()
    steps: tuple[Step, ...] = ()

    @property
    def moves(self) -> bool:
        """Whether it grows or falls, has jumped, or wanders by more than its intervals."""
        return self.trend.verdict in ("rising", "falling") or bool(self.steps) or self.trend.wanders


def by_urgency(series: Sequence[Series]) -> list[Series]:
    """Those first that leave their band soonest, then those that move, then the others by name."""

    def key(one: Series) -> tuple[bool, float, bool, str]:
        at = one.leaves_band.at if one.leaves_band else None
        return at is None, at.timestamp() if at else 0.0, not one.moves, one.name

    return sorted(series, key=key)


def promotions(store: VersionStore) -> list[Promotion]:
    """Every promotion that stood, oldest first. A clock that was set back does not turn time around."""
    found = store.everything().versions
    standing: list[tuple[str, str | None]] = []
    for decision in store.decisions().decisions:
        _follow(standing, decision)
    out: list[Promotion] = []
    for version_id, at in standing:
        version = found.get(version_id)
        made = at or (version.created if version is not None else None)
        if version is None or made is None or any(version_id == earlier.version.id for earlier in out):
            continue  # promoting a version again is no new look at the hand
        when = datetime.fromisoformat(made)
        out.append(Promotion(max(when, out[-1].at) if out else when, version, at is not None))
    return out


def history(
    store: VersionStore,
    names: Sequence[str] = (),
    *,
    limits: Mapping[str, tuple[float | None, float | None]] | None = None,
    covariate: Callable[[datetime], float] | None = None,
) -> list[Series]:
    """All series, or those whose names are given (whole, or a part of them such as a joint). Raises BadInput.

    `limits` are bands by name that stand in for those of the search; `covariate` tells what else acted at a time.
    """
    promoted = promotions(store)
    if not promoted:
        raise BadInput(
            f"no version of {store.hand} was ever promoted, so there is no history",
            todo="Promote one: 'twin versions promote'",
        )
    gathered = _gathered(promoted)
    units: dict[str, str] = {}
    bands: dict[str, tuple[float | None, float | None]] = {}
    for promotion in promoted:
        for name, record in promotion.version.parameters.items():
            units[name] = record.unit or units.get(name, "")
            if record.lower is not None or record.upper is not None:
                bands[name] = (record.lower, record.upper)
    today = max(store.now(), promoted[-1].at)
    bands |= limits or {}
    among = sum(len(_measured(points)) > 1 for points in gathered.values())
    return [
        _series(
            name,
            units.get(name, _of_library(name)[0]),
            points,
            bands.get(name, _of_library(name)[1]),
            today,
            covariate,
            among,
        )
        for name, points in _chosen(gathered, names).items()
    ]


def changing(store: VersionStore, limits: Mapping[str, tuple[float | None, float | None]]) -> list[Series]:
    """What grows, falls, jumps or wanders, the most urgent first; none where no version was ever promoted."""
    if not promotions(store):
        return []
    return by_urgency([one for one in history(store, limits=limits) if one.moves])


def measured_points(store: VersionStore) -> dict[str, list[Point]]:
    """What was fitted of each value in versions that were promoted, oldest first."""
    return {name: _measured(points) for name, points in _gathered(promotions(store)).items()}


def _gathered(promoted: Sequence[Promotion]) -> dict[str, list[Point]]:
    found: dict[str, list[Point]] = {}
    for promotion in promoted:
        for name, value, ci95 in _values(promotion.version):
            found.setdefault(name, []).append(Point(promotion.at, promotion.version.id, value, ci95))
    return found


def _follow(standing: list[tuple[str, str | None]], decision: Decision) -> None:
    if decision.what == "promoted" and decision.version:
        if not standing or standing[-1][0] != decision.version:
            standing.append((decision.version, decision.at))
    elif decision.what == "rolled_back" and standing:
        standing.pop()
    elif decision.what == "checkpoint" and not standing:
        standing += [(version, None) for version in decision.promoted]


def _values(version: Version) -> Iterator[tuple[str, float, tuple[float, float] | None]]:
    """Everything that a version sets, fitted or carried over."""
    fitted = {name: p for name, p in version.parameters.items() if p.value is not None}
    for name, value in version.sets().items():
        if name not in fitted and isinstance(value, (int, float)) and not isinstance(value, bool):
            yield name, float(value), None
    for name, parameter in fitted.items():
        yield name, float(parameter.value or 0.0), parameter.ci95


def _of_library(name: str) -> tuple[str, tuple[float | None, float | None]]:
    """Unit and bounds of "effect:target.value" as the library of effects knows them."""
    place, _, value = name.rpartition(".")
    effect = LIBRARY.get(place.partition(":")[0]) if ":" in place else None
    for parameter in effect.parameters if effect is not None else ():
        if parameter.name == value:
            return parameter.unit, (parameter.lower, parameter.upper)
    return "", (None, None)


def _chosen(gathered: dict[str, list[Point]], names: Sequence[str]) -> dict[str, list[Point]]:
    chosen: dict[str, list[Point]] = {}
    for wanted in names:
        found = [wanted] if wanted in gathered else [name for name in gathered if wanted in name]
        if not found:
            raise BadInput(f"no promoted version has a parameter '{wanted}'", todo=nearest(wanted, gathered))
        chosen |= {name: gathered[name] for name in found}
    return chosen if names else gathered


def _series(
    name: str,
    unit: str,
    points: list[Point],
    band: tuple[float | None, float | None],
    today: datetime,
    covariate: Callable[[datetime], float] | None,
    among: int,
) -> Series:
    start = points[0].at
    trend = fit_trend(
        [
            Sample(_days(p.at - start), p.value, p.ci95, None if covariate is None else covariate(p.at))
            for p in _measured(points)
        ],
        among,
    )
    left = leaving(trend, band, _days(today - start))
    levels = tuple(Level(start + timedelta(days=day), level, ci95) for day, level, ci95 in trend.band)
    steps = tuple(
        Step(_date(start, one.before_day), _date(start, one.day), one.size, one.ci95, one.is_repair)
        for one in trend.jumps
    )
    return Series(name, unit, tuple(points), band, trend, None if left is None else _dated(left, start), levels, steps)


def _measured(points: list[Point]) -> list[Point]:
    """What was fitted; where nothing was, each value once, when it was set."""
    fitted = [point for point in points if point.ci95 is not None]
    if fitted:
        return fitted
    return [p for i, p in enumerate(points) if i == 0 or p.value != points[i - 1].value]


def _dated(left: Leaving, start: datetime) -> LeavesBand:
    return LeavesBand(
        bound=left.bound,
        value=left.value,
        at=_date(start, left.day),
        earliest=_date(start, left.earliest_day),
        latest=_date(start, left.latest_day),
    )


def _date(start: datetime, day: float) -> datetime | None:
    try:
        return start + timedelta(days=day)
    except OverflowError:  # infinite as well
        return None


def _days(span: timedelta) -> float:
    return span.total_seconds() / _DAY_S
