"""The residual of one joint over position, velocity, load and time since a reversal, with what candidates predict."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import plotly.graph_objects as go

from twin_daemon.comparison.dependence import Plot
from twin_daemon.figures.style import DOWN, MEASURED, REFERENCE, TWIN, UP, label, styled

_WAYS = {"moving up": (UP, "circle"), "moving down": (DOWN, "x-thin-open")}
_CANDIDATES = ((TWIN, "solid"), (MEASURED, "dash"), (REFERENCE, "dot"))
_ACROSS = ((0.0, 0.46), (0.54, 1.0))
_UP = ((0.58, 1.0), (0.0, 0.42))


def dependence_figure(plots: Sequence[Plot], joint: str) -> go.Figure:
    """Two by two: measured residuals (mrad) as points in two colours and shapes by direction, and the curve of each
    candidate by direction. All have one scale."""
    figure = go.Figure()
    axes: dict[str, Any] = {}
    for number, plot in enumerate(plots[:4]):
        end = "" if number == 0 else str(number + 1)
        for way, (x, y) in plot.points.items():
            colour, symbol = _WAYS[way]
            marker = {"color": colour, "size": 4, "symbol": symbol, "line": {"color": colour, "width": 1}}
            figure.add_trace(_curve(x, y, way, number, mode="markers", marker=marker))
        for (name, ways), (colour, dash) in zip(plot.curves.items(), _CANDIDATES, strict=False):
            for first, (x, y) in enumerate(ways.values()):
                line = {"color": colour, "width": 2.5, "dash": dash}
                trace = _curve(x, y, f"{label(name)} predicts", number, mode="lines", line=line)
                figure.add_trace(trace.update(showlegend=not number and not first))
        title = f"{plot.name} ({plot.unit})"
        axes[f"xaxis{end}"] = {"title": title, "domain": _ACROSS[number % 2], "anchor": f"y{end}"}
        axes[f"yaxis{end}"] = {
            "domain": _UP[number // 2],
            "anchor": f"x{end}",
            "title": "mrad" if not number % 2 else "",
        }
        if number:
            axes[f"yaxis{end}"] |= {"matches": "y"}
    styled(figure, label(joint), height=460)
    return figure.update_layout(hovermode="closest", **axes)


def _curve(x: np.ndarray, y: np.ndarray, name: str, number: int, **look: Any) -> go.Scatter:
    end = "" if number == 0 else str(number + 1)
    return go.Scatter(
        x=np.round(x, 5), y=np.round(y, 3), name=name, legendgroup=name, showlegend=number == 0,
        xaxis=f"x{end}", yaxis=f"y{end}", hovertemplate="%{y:.2f} mrad at %{x:.3f}", **look,
    )  # fmt: skip
