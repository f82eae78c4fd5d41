"""A hand's history in words: where a parameter is heading, what jumped, what appeared or went."""

from __future__ import annotations

from collections.abc import Sequence

from twin_daemon.versions.history import LeavesBand, Promotion, Series, Step
from twin_daemon.versions.trend import Trend

_WEEK_DAYS = 7.0


def heading(series: Series) -> str:
    """Where a series is heading, in words."""
    trend, left = series.trend, series.leaves_band
    if trend.verdict == "too_few":
        return "too few values for a trend"
    if trend.slope_per_day is None or trend.slope_ci95 is None:
        return "no trend"
    said = [_step(series, one) for one in series.steps]
    if trend.wanders:
        said.append(
            "looks differ by more than their intervals, as by temperature or load: ambiguous"
            + ("" if trend.covariate_effect else "; --covariate FILE tells them from wear")
        )
    if trend.verdict == "no_trend":
        return "; ".join(["no trend", *said])
    return "; ".join([_growth(series, trend, left), *said])


def _step(series: Series, step: Step) -> str:
    """One jump in words."""
    when = step.until.date().isoformat() if step.until else "?"
    what = "a repair" if step.is_repair else "a jump"
    return f"{what} by {step.size:+.3g} [{step.ci95[0]:.3g}, {step.ci95[1]:.3g}] in the week to {when}"


def _growth(series: Series, trend: Trend, left: LeavesBand | None) -> str:
    """Growth by week, and when a limit is reached."""
    assert trend.slope_per_day is not None
    assert trend.slope_ci95 is not None
    week = [_WEEK_DAYS * slope for slope in (trend.slope_per_day, *trend.slope_ci95)]
    text = f"{week[0]:+.3g} [{week[1]:.3g}, {week[2]:.3g}] a week"
    if left is None:
        return f"{text}; its band is not known" if series.band == (None, None) else text
    if left.at is None:
        return f"{text}; not within this age of the world"
    ends = [when.date().isoformat() if when else "never" for when in (left.earliest, left.latest)]
    return f"{text}; leaves its band at {left.value:.4g} about {left.at.date().isoformat()} ({ends[0]} to {ends[1]})"


def lifetime(series: Series, promoted: Sequence[Promotion]) -> str:
    """When something appeared or went, where it was not there all along."""
    first, last = series.points[0], series.points[-1]
    said = [f"appeared {first.at.date()}"] if first.version != promoted[0].version.id else []
    said += [f"last seen {last.at.date()}"] if last.version != promoted[-1].version.id else []
    return ", ".join(said)
