"""How the error falls from the nominal model with each effect that was added, down to the sensors' noise."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import sqrt

import plotly.graph_objects as go

from twin_daemon.figures.style import REFERENCE, RESIDUAL, TWIN, UP, label, styled


def waterfall_figure(steps: Sequence[tuple[str, float]], noise_floor_rad2: float | None) -> go.Figure:
    """`steps` are what was added and the mean squared error (rad^2) after it; the first is the model before all."""
    roots = [1e3 * sqrt(error) for _, error in steps]
    names = [label(name) for name, _ in steps]
    noise = [] if noise_floor_rad2 is None else [1e3 * sqrt(noise_floor_rad2)]
    falls = [after - before for before, after in pairwise(roots)]
    words = [f"{roots[0]:.3g} mrad", *(f"{fall:+.3g}" for fall in falls), f"{roots[-1]:.3g} mrad"]
    figure = go.Figure(
        go.Waterfall(
            x=[*names, "left", *(["sensors' noise"] if noise else [])],
            y=[roots[0], *falls, 0.0, *noise],
            measure=["absolute", *("relative" for _ in falls), "total", *("absolute" for _ in noise)],
            text=[*words, *(f"{value:.3g} mrad" for value in noise)],
            textposition="outside",
            cliponaxis=False,
            decreasing={"marker": {"color": UP}},
            increasing={"marker": {"color": TWIN}},
            totals={"marker": {"color": RESIDUAL}},
            connector={"line": {"color": REFERENCE, "width": 1}},
            hovertemplate="%{x}: %{text}<extra></extra>",
        )
    )
    figure.update_yaxes(title_text="rms error (mrad)", rangemode="tozero")
    return styled(figure, "", height=340)
