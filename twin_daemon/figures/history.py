"""Parameters and values of effects over time, with intervals, bands and where the trend leads."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from twin_daemon.figures.style import MEASURED, REFERENCE, RESIDUAL, TWIN, interval_bars, styled
from twin_daemon.versions.history import Point, Series, by_urgency

_ROW_PX, _HEAD_PX = 200, 90
MOST_SERIES = 24


def history_figure(hand: str, series: Sequence[Series]) -> go.Figure:
    """One row of axes a series, the most urgent first; at most 24."""
    chosen = by_urgency(series)[:MOST_SERIES]
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
            figure.add_trace(_band(one), row=row, col=1)
            figure.add_trace(line, row=row, col=1)
        for step in one.steps:
            if step.until is not None:
                figure.add_vline(x=step.until, line={"color": RESIDUAL, "dash": "dot", "width": 1}, row=row, col=1)  # type: ignore[arg-type]
        for bound in one.band:
            if bound is not None and _near(bound, one):
                figure.add_hline(y=bound, line={"color": MEASURED, "dash": "dot", "width": 1}, row=row, col=1)  # type: ignore[arg-type]
        figure.update_yaxes(title_text=one.unit, row=row, col=1)
    return styled(figure, f"The history of {hand}", height=height)


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
    """The smoothed level, on to the band where it leaves that within four times the time watched."""
    levels, left = series.levels, series.leaves_band
    if not levels:
        return None
    shown = [(one.at, one.value) for one in levels]
    if left is not None and left.at is not None and left.at - shown[0][0] < 4 * (shown[-1][0] - shown[0][0]):
        shown.append((left.at, left.value))
    return go.Scatter(
        x=[at for at, _ in shown],
        y=[value for _, value in shown],
        name="level",
        legendgroup="level",
        showlegend=False,
        mode="lines",
        line={"color": RESIDUAL, "dash": "solid" if series.trend.verdict != "no_trend" else "dash", "width": 1.5},
        hovertemplate="level %{y:.4g}",
    )


def _band(series: Series) -> go.Scatter:
    """The interval of the level, as an area."""
    levels = series.levels
    return go.Scatter(
        x=[one.at for one in levels] + [one.at for one in reversed(levels)],
        y=[one.ci95[0] for one in levels] + [one.ci95[1] for one in reversed(levels)],
        name="95 % of the level",
        legendgroup="level",
        showlegend=False,
        mode="none",
        fill="toself",
        fillcolor="rgba(128,128,128,0.18)",
        hoverinfo="skip",
    )


def _near(bound: float, series: Series) -> bool:
    """Whether a bound can be shown without flattening what was measured."""
    values = [p.value for p in series.points] + [end for p in series.points for end in p.ci95 or ()]
    span = max(values) - min(values)
    nearest = min(abs(bound - value) for value in values)
    return nearest <= 3.0 * span or (series.leaves_band is not None and series.leaves_band.value == bound)
