"""Measured against twin by joint, with the residual below."""

from __future__ import annotations

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from twin_daemon.comparison.compare import Comparison
from twin_daemon.figures.overlay import reduced
from twin_daemon.figures.style import MEASURED, RESIDUAL, TWIN, label, styled

_BUCKETS = 1000


def comparison_figure(comparison: Comparison, *, most: int = 12) -> go.Figure:
    """The joints that move, worst first: measured and twin in one row, their difference in the next."""
    moving = [(e.mse_rad2, name) for name, e in comparison.joints.items() if e.moves]
    names = [name for _, name in sorted(moving, reverse=True)[:most]]
    titles = [t for name in names for t in (f"{label(name)}: rmse {comparison.joints[name].rmse_rad:.2e} rad", "")]
    figure = make_subplots(
        rows=max(2 * len(names), 1),
        cols=1,
        shared_xaxes=True,
        row_heights=[2.0, 1.0] * len(names) or [1.0],
        vertical_spacing=0.15 / max(2 * len(names), 1),
        subplot_titles=titles or [""],
    )
    for row, name in enumerate(names):
        time_s, measured, twin, _ = reduced(comparison, name, _BUCKETS)
        first = row == 0
        rows = (
            (measured, "measured", MEASURED, 0),
            (twin, "twin", TWIN, 0),
            (measured - twin, "residual", RESIDUAL, 1),
        )
        for values, words, colour, below in rows:
            trace = go.Scattergl(
                x=time_s,
                y=values,
                name=words,
                legendgroup=words,
                showlegend=first,
                line={"color": colour, "width": 1.4},
            )
            figure.add_trace(trace, row=2 * row + 1 + below, col=1)
        figure.update_yaxes(title_text="rad", row=2 * row + 1, col=1)
        figure.update_yaxes(title_text="difference", row=2 * row + 2, col=1)
    figure.update_xaxes(title_text="time since the first sample (s)", row=max(2 * len(names), 1), col=1)
    title = f"{label(comparison.aligned.recording.name)}: measured against twin"
    return styled(figure, title, height=160 + 260 * max(len(names), 1))
