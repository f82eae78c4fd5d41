"""What an effect does to a motion, as one would meet it in a residual."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from twin_daemon.figures.reduce import keep_extremes
from twin_daemon.figures.style import REFERENCE, RESIDUAL, TWIN, label, styled
from twin_daemon.simulation.signature import Signature

_BUCKETS = 300


def effect_figure(key: str, found: Signature) -> go.Figure:
    """Commanded, without and with the effect (rad) above; below what a twin without it would be wrong by (mrad)."""
    gap_mrad = 1e3 * (found.with_effect - found.without)
    kept = keep_extremes(np.column_stack([found.commanded, found.without, found.with_effect, gap_mrad]), _BUCKETS)
    figure = go.Figure()
    for values, name, colour, dash, axis in (
        (found.commanded, "commanded", REFERENCE, "dot", "y"),
        (found.without, "without", REFERENCE, "solid", "y"),
        (found.with_effect, f"with {key}", TWIN, "solid", "y"),
        (gap_mrad, "difference", RESIDUAL, "solid", "y2"),
    ):
        line = {"color": colour, "dash": dash, "width": 1.5}
        x, y = found.time_s[kept].astype(np.float32), values[kept].astype(np.float32)
        figure.add_trace(go.Scatter(x=x, y=y, name=name, mode="lines", line=line, yaxis=axis))
    styled(figure, label(f"{key} at {found.name}: {found.amounts}"), height=380)
    return figure.update_layout(
        xaxis={"title": "time (s)", "anchor": "y2"},
        yaxis={"title": "rad", "domain": [0.42, 1.0]},
        yaxis2={"title": "difference (mrad)", "domain": [0.0, 0.34], "zeroline": True},
    )
