"""Parameters and values of effects over time, with intervals, bands and where the trend leads."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import timedelta

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from twin_daemon.figures.style import MEASURED, REFERENCE, RESIDUAL, TWIN, interval_bars, styled
from twin_daemon.versions.history import Point, Series

_ROW_PX, _HEAD_PX = 200, 90
MOST_SERIES = 24


def history_figure(hand: str, series: Sequence[Series]) -> go.Figure:
    """One row of axes a series, those that leave their band first; at most 24."""
    chosen = sorted(series, key=_urgency)[:MOST_SERIES]
    titles = [f"{s.name}: {s.trend.verdict.replace('_', ' ')}" for s in chosen]
    height = _HEAD_PX + _ROW_PX * max(1, len(chosen))
    figure = make_subplots(
        rows=max(1, len(chosen)),
        cols=1,
        shared_xaxes=True,
        subplot_titles=titles,
        vertical_spacing=min(0.06, 0.5 / max(1, len(chosen))),
    )
    for row, one in enumerate(chosen, start=1):
        fitted = [point for point in one.points if point.ci95 is not None]
        carried = [point for point in one.points if point.ci95 is None]
        figure.add_trace(_points("fitted, 95 % interval", fitted, TWIN, "circle", row == 1), row=row, col=1)
        figure.add_trace(_points("carried over or set", carried, REFERENCE, "circle-open", row == 1), row=row, col=1)
        line = _line(one)
        if line is not None:
            figure.add_trace(line, row=row, col=1)
        for bound in one.band:
            if bound is not None and _near(bound, one):
                figure.add_hline(y=bound, line={"color": MEASURED, "dash": "dot", "width": 1}, row=row, col=1)  # type: ignore[arg-type]
        figure.update_yaxes(title_text=one.unit, row=row, col=1)
    return styled(figure, f"The history of {hand}", height=height)


def _urgency(series: Series) -> tuple[bool, float, str]:
    at = series.leaves_band.at if series.leaves_band else None
    return at is None, at.timestamp() if at else 0.0, series.name


def _points(name: str, points: Sequence[Point], colour: str, symbol: str, shown: bool) -> go.Scatter:
    values = [p.value for p in points]
    return go.Scatter(
        x=[p.at for p in points],
        y=values,
        name=name,
        legendgroup=name,
        showlegend=shown,
        mode="markers",
        marker={"color": colour, "symbol": symbol, "size": 8},
        error_y=interval_bars(values, [p.ci95 for p in points], colour),
        customdata=[p.version[:12] for p in points],
        hovertemplate="%{y:.4g} (%{customdata})",
    )


def _line(series: Series) -> go.Scatter | None:
    """The trend, up to the band where it leaves it within four times the time watched."""
    trend, start, last = series.trend, series.points[0].at, series.points[-1].at
    if trend.slope_per_day is None or trend.level is None or trend.day is None:
        return None
    days = [0.0, (last - start) / timedelta(days=1)]
    left = series.leaves_band.at if series.leaves_band else None
    if left is not None and left - start < 4 * (last - start):
        days.append((left - start) / timedelta(days=1))
    return go.Scatter(
        x=[start + timedelta(days=day) for day in days],
        y=[trend.level + trend.slope_per_day * (day - trend.day) for day in days],
        name="trend",
        legendgroup="trend",
        showlegend=False,
        mode="lines",
        line={"color": RESIDUAL, "dash": "solid" if trend.verdict != "no_trend" else "dash", "width": 1.5},
        hovertemplate="trend %{y:.4g}",
    )


def _near(bound: float, series: Series) -> bool:
    """Whether a bound can be shown without flattening what was measured."""
    values = [p.value for p in series.points] + [end for p in series.points for end in p.ci95 or ()]
    span = max(values) - min(values)
    nearest = min(abs(bound - value) for value in values)
    return nearest <= 3.0 * span or (series.leaves_band is not None and series.leaves_band.value == bound)
