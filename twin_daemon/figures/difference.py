"""Two versions side by side: each value that differs with its 95 % interval, one row of axes a kind of value."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from twin_daemon.figures.style import REFERENCE, TWIN, interval_bars, styled
from twin_daemon.versions import VersionDiff

_ROW_PX, _HEAD_PX = 34, 90


class _Line(NamedTuple):
    label: str
    kind: str
    before: float | None
    before_ci95: tuple[float, float] | None
    after: float | None
    after_ci95: tuple[float, float] | None


def difference_figure(change: VersionDiff, before: str, after: str) -> go.Figure:
    """`before` and `after` are what to call the versions. Values in the unit that their axis names."""
    lines = list(_lines(change))
    kinds = list(dict.fromkeys(line.kind for line in lines)) or ["nothing differs"]
    counts = [max(1, sum(line.kind == kind for line in lines)) for kind in kinds]
    height = _HEAD_PX * (len(kinds) + 1) + _ROW_PX * sum(counts)
    figure = make_subplots(
        rows=len(kinds), cols=1, row_heights=counts, subplot_titles=kinds, vertical_spacing=_HEAD_PX * 0.8 / height
    )
    for row, kind in enumerate(kinds, start=1):
        own = [line for line in lines if line.kind == kind]
        labels = [line.label for line in own]
        sides = (
            (before, REFERENCE, "circle-open", [(line.before, line.before_ci95) for line in own]),
            (after, TWIN, "diamond", [(line.after, line.after_ci95) for line in own]),
        )
        for name, colour, symbol, values in sides:
            figure.add_trace(_side(name, colour, symbol, labels, values, row == 1), row=row, col=1)
    figure.update_yaxes(autorange="reversed", automargin=True)
    figure = styled(figure, f"From {before} to {after}", height=height)
    return figure.update_layout(hovermode="closest")


def _side(
    name: str,
    colour: str,
    symbol: str,
    labels: list[str],
    values: list[tuple[float | None, tuple[float, float] | None]],
    shown: bool,
) -> go.Scatter:
    numbers, intervals = [value for value, _ in values], [ci95 for _, ci95 in values]
    return go.Scatter(
        x=numbers,
        y=labels,
        name=name,
        legendgroup=name,
        showlegend=shown,
        mode="markers",
        marker={"color": colour, "symbol": symbol, "size": 10},
        error_x=interval_bars(numbers, intervals, colour),
        hovertemplate="%{y}: %{x:.4g}",
    )


def _lines(change: VersionDiff) -> Iterator[_Line]:
    seen = set()
    for p in change.parameters:
        place, _, kind = p.name.rpartition(".")
        seen.add(p.name)
        unit = f" ({p.unit})" if p.unit else ""
        yield _Line(place or p.name, kind + unit, p.before, p.before_ci95, p.after, p.after_ci95)
    for effect, before, after in _effects(change):
        place = f"{effect['effect']}:{effect['target']}"
        for name in dict.fromkeys([*before, *after]):
            if f"{place}.{name}" not in seen and before.get(name) != after.get(name):
                yield _Line(place, name, before.get(name), None, after.get(name), None)


def _effects(change: VersionDiff) -> Iterator[tuple[dict[str, Any], dict[str, float], dict[str, float]]]:
    for effect in change.effects_added:
        yield effect, {}, effect.get("values") or {}
    for effect in change.effects_removed:
        yield effect, effect.get("values") or {}, {}
    for effect in change.effects_changed:
        yield effect, effect["before"], effect["after"]
