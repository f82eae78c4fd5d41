"""Joints by condition as a heat map: where the model fails, and while doing what."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from twin_daemon.comparison.conditions import CONDITIONS, ConditionError
from twin_daemon.figures.style import LARGE_ERROR, NO_ERROR, SOME_ERROR, label, styled

_SHORT = {
    "moving up": "moving<br>up",
    "moving down": "moving<br>down",
    "just after a reversal": "after a<br>reversal",
    "lower third of its travel": "lower third<br>of travel",
    "middle third of its travel": "middle third<br>of travel",
    "upper third of its travel": "upper third<br>of travel",
}


def conditions_figure(errors: Sequence[ConditionError]) -> go.Figure:
    """Root mean square residual (mrad) in words and as colour (logarithmic), the joint with the worst cell first.

    `customdata` of a cell is [recording number, time (s)] of its largest residual, or null.
    """
    joints = list(dict.fromkeys(error.joint for error in errors))
    rmse = np.full((len(joints), len(CONDITIONS)), np.nan)
    words = [["" for _ in CONDITIONS] for _ in joints]
    hover = [["" for _ in CONDITIONS] for _ in joints]
    moments: list[list[list[float] | None]] = [[None for _ in CONDITIONS] for _ in joints]
    for error in errors:
        row, column = joints.index(error.joint), CONDITIONS.index(error.condition)
        rmse[row, column] = error.rmse_rad
        words[row][column] = f"{1e3 * error.rmse_rad:.3g}"
        moments[row][column] = [error.worst_in, error.worst_s]
        hover[row][column] = (
            f"{label(error.joint)}, {error.condition}<br>rmse {1e3 * error.rmse_rad:.3g} mrad, "
            f"bias {1e3 * error.bias_rad:+.3g} mrad<br>{error.times_average:.2g} times the joint's average, "
            f"over {error.seconds:.3g} s<br>worst at {error.worst_s:.3f} s of recording {error.worst_in + 1}"
        )
    figure = go.Figure(
        go.Heatmap(
            z=np.log10(np.maximum(rmse, 1e-9)).tolist(),
            x=[_SHORT.get(name, name) for name in CONDITIONS],
            y=[label(joint) for joint in joints],
            text=words,
            texttemplate="%{text}",
            hovertext=hover,
            hovertemplate="%{hovertext}<extra></extra>",
            customdata=moments,
            colorscale=[[0.0, NO_ERROR], [0.6, SOME_ERROR], [1.0, LARGE_ERROR]],
            showscale=False,
            xgap=2,
            ygap=2,
        )
    )
    styled(figure, "rms residual (mrad) by joint and condition", height=64 + 30 * max(len(joints), 1))
    return figure.update_layout(
        hovermode="closest",
        xaxis={"side": "top", "showgrid": False, "fixedrange": True, "tickangle": 0, "tickfont": {"size": 11}},
        yaxis={"autorange": "reversed", "showgrid": False, "fixedrange": True, "type": "category", "automargin": True},
    )
