"""The twin's error between what it has to beat and what no model can go below."""

from __future__ import annotations

from collections.abc import Mapping

import plotly.graph_objects as go

from twin_daemon.figures.style import MEASURED, REFERENCE, TWIN, label, styled

TWIN_LEVEL, NOISE_LEVEL = "this twin", "noise floor of the sensors"


def references_figure(levels: Mapping[str, float | None]) -> go.Figure:
    """Mean squared errors (rad^2) by name on a log axis, in the order given; None is left out."""
    known = {name: value for name, value in levels.items() if value}
    colours = [TWIN if name == TWIN_LEVEL else MEASURED if name == NOISE_LEVEL else REFERENCE for name in known]
    names = [label(name) for name in known]
    figure = go.Figure(
        go.Scatter(
            x=list(known.values()),
            y=names,
            name="mean squared error",
            mode="markers+text",
            marker={"size": 14, "color": colours, "symbol": ["diamond" if c == TWIN else "circle" for c in colours]},
            text=[f"{value:.3g}" for value in known.values()],
            textposition="top center",
            cliponaxis=False,
            hovertemplate="%{x:.4g} rad²<extra></extra>",
        )
    )
    styled(figure, "mean squared error (rad²)", height=90 + 44 * max(len(known), 1))
    return figure.update_layout(
        hovermode="closest",
        xaxis={"type": "log", "exponentformat": "power", "title": "rad²"},
        yaxis={"autorange": "reversed", "type": "category", "automargin": True},
    )
