"""The curve of a proposed law with its band."""

from __future__ import annotations

from typing import TYPE_CHECKING

import plotly.graph_objects as go

if TYPE_CHECKING:
    from twin_daemon.proposals.proposal import Curve


def law_figure(curve: Curve, name: str) -> go.Figure:
    """Values over their variable with the 95 % band; what lies beyond the visited range is shaded."""
    figure = go.Figure()
    for side, fill in ((curve.upper, None), (curve.lower, "tonexty")):
        figure.add_scatter(
            x=curve.at, y=side, fill=fill, mode="lines", line={"width": 0}, hoverinfo="skip",
            name="95 %" if fill else "", showlegend=fill is not None, fillcolor="rgba(120,140,170,0.3)",
        )  # fmt: skip
    mode = "markers" if curve.at[0] == curve.at[-1] else "lines"  # a memory of one element has no line
    figure.add_scatter(x=curve.at, y=curve.value, mode=mode, name="law")
    low, high = curve.visited
    if high > low:
        for start, end in ((curve.at[0], low), (high, curve.at[-1])):
            if end > start:
                figure.add_vrect(x0=start, x1=end, fillcolor="rgba(128,128,128,0.15)", line_width=0)
    figure.update_xaxes(title=curve.at_unit)
    figure.update_yaxes(title=name)
    figure.update_layout(height=320)
    return figure
