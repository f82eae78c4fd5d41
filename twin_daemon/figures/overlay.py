"""One joint over time: measured, twin and command, with the residual below."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from twin_daemon.comparison.compare import Comparison
from twin_daemon.figures.reduce import keep_extremes
from twin_daemon.figures.style import BAND, MEASURED, REFERENCE, RESIDUAL, TWIN, label, styled

BUCKETS = 320
"""What a figure is drawn from at most: buckets over the whole recording, each with its extremes."""

_TIME = "time since the first sample (s)"


def overlay_figure(
    comparison: Comparison, joint: str, command: np.ndarray | None = None, *, buckets: int = BUCKETS
) -> go.Figure:
    """Measured and twin (rad) above, their difference (mrad) below, with what the sensor's noise is of it.

    `command` (n,) rad is what the raw command alone would predict; without one, or where it is NaN, none is drawn.
    """
    time_s, measured, twin, kept = reduced(comparison, joint, buckets)
    figure = go.Figure()
    if command is not None and np.isfinite(command).any():
        figure.add_trace(_line(time_s, command[kept], "raw command", REFERENCE, dash="dot"))
    figure.add_trace(_line(time_s, measured, "measured", MEASURED))
    figure.add_trace(_line(time_s, twin, "twin", TWIN, dash="solid"))
    figure.add_trace(_line(time_s, 1e3 * (measured - twin), "residual", RESIDUAL).update(yaxis="y2"))
    styled(figure, label(joint), height=300)
    noise_mrad = 2e3 * float(np.sqrt(comparison.joints[joint].noise_rad2))
    end = float(comparison.aligned.time_s[-1])
    return figure.update_layout(
        xaxis={"title": _TIME, "anchor": "y2", "range": [0.0, end]},
        yaxis={"title": "rad", "domain": [0.4, 1.0]},
        yaxis2={"title": "residual (mrad)", "domain": [0.0, 0.32], "zeroline": True},
        shapes=[
            {
                "name": "two sigma of the sensor's noise",
                "type": "rect",
                "layer": "below",
                "xref": "paper",
                "x0": 0.0,
                "x1": 1.0,
                "yref": "y2",
                "y0": -noise_mrad,
                "y1": noise_mrad,
                "fillcolor": BAND,
                "line": {"width": 0},
            }
        ],
    )


def reduced(comparison: Comparison, joint: str, buckets: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """(time s, measured rad, twin rad, indices of the samples kept), all (m,), for a drawing of so many buckets."""
    aligned = comparison.aligned
    column = aligned.joints.index(joint)
    measured, twin = aligned.measured[:, column], comparison.predicted[:, column]
    kept = keep_extremes(np.column_stack([measured, twin, measured - twin]), buckets)
    return aligned.time_s[kept], measured[kept], twin[kept], kept


def _line(time_s: np.ndarray, values: np.ndarray, name: str, colour: str, dash: str = "solid") -> go.Scatter:
    return go.Scatter(
        x=time_s.astype(np.float32),
        y=values.astype(np.float32),
        name=name,
        mode="lines",
        line={"color": colour, "width": 1.4, "dash": dash},
    )
