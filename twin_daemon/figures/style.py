"""One look for all figures; colours are told apart by lightness too, and every trace has its name in words."""

from __future__ import annotations

import html
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import plotly.graph_objects as go

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically

MEASURED, TWIN, RESIDUAL, REFERENCE = "#1b1f24", "#d9480f", "#1971c2", "#868e96"
UP, DOWN, BAND = "#0b7285", "#c2255c", "#dee2e6"
NO_ERROR, SOME_ERROR, LARGE_ERROR = "#f8f9fa", "#ffc078", "#a61e4d"

DARK = {
    MEASURED: "#f1f3f5",
    TWIN: "#ff922b",
    RESIDUAL: "#74c0fc",
    REFERENCE: "#adb5bd",
    UP: "#66d9e8",
    DOWN: "#faa2c1",
    BAND: "#343a40",
    NO_ERROR: "#212529",
    SOME_ERROR: "#7a4100",
    LARGE_ERROR: "#c2255c",
}
"""What each colour becomes on a dark ground."""


def label(name: object) -> str:
    """A name that came from a file, as text of a figure: Plotly reads tags and entities in its texts."""
    return html.escape(str(name), quote=False)


def styled(figure: go.Figure, title: str, *, height: int) -> go.Figure:
    """The common layout: white, thin grid, one hover line through all rows. `title` is a text as of `label`."""
    return figure.update_layout(
        title=title,
        template="plotly_white",
        height=height,
        hovermode="x unified",
        legend={"orientation": "h", "y": 1.02, "yanchor": "bottom", "x": 1, "xanchor": "right"},
        margin={"l": 70, "r": 20, "t": 90, "b": 50},
    )


def interval_bars(
    values: Sequence[float | None], intervals: Sequence[tuple[float, float] | None], colour: str
) -> dict[str, Any]:
    """Error bars from each value to the ends of its interval; none where either is unknown."""
    pairs = list(zip(values, intervals, strict=True))
    above = [ends[1] - value if ends and value is not None else 0.0 for value, ends in pairs]
    below = [value - ends[0] if ends and value is not None else 0.0 for value, ends in pairs]
    return {"type": "data", "symmetric": False, "array": above, "arrayminus": below, "color": colour}


def write_page(figure: go.Figure, path: Path) -> None:
    """One self-contained HTML page without requests to anywhere."""
    if not path.absolute().parent.is_dir():
        raise BadInput("the folder does not exist", where=path, todo=f"Create {path.parent} or name another path")
    write_atomically(path, figure.to_html(include_plotlyjs=True, full_html=True).encode())
