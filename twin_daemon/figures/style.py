"""One look for all figures; colours are told apart by lightness too, and every trace has its name in words."""

from __future__ import annotations

from pathlib import Path

import plotly.graph_objects as go

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically

MEASURED, TWIN, RESIDUAL, REFERENCE = "#1b1f24", "#d9480f", "#1971c2", "#868e96"


def styled(figure: go.Figure, title: str, *, height: int) -> go.Figure:
    """The common layout: white, thin grid, one hover line through all rows."""
    return figure.update_layout(
        title=title,
        template="plotly_white",
        height=height,
        hovermode="x unified",
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 1, "xanchor": "right"},
        margin={"l": 70, "r": 20, "t": 90, "b": 50},
    )


def write_page(figure: go.Figure, path: Path) -> None:
    """One self-contained HTML page without requests to anywhere."""
    if not path.absolute().parent.is_dir():
        raise BadInput("the folder does not exist", where=path, todo=f"Create {path.parent} or name another path")
    html = figure.to_html(include_plotlyjs=True, full_html=True)
    write_atomically(path, html.encode())
