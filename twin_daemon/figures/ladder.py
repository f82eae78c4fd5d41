"""The error by step of a ladder, on a log axis, with what it has to beat and what no model can go below."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import plotly.graph_objects as go

from twin_daemon.figures.style import MEASURED, REFERENCE, RESIDUAL, TWIN, label, styled

_LINES = (
    ("raw_command", "raw command", "dot"),
    ("last_promoted", "last promoted version", "dash"),
    ("parameters_alone", "parameters alone, no effect", "dashdot"),
)


def ladder_figure(
    title: str,
    steps: Sequence[Mapping[str, Any]],
    references: Mapping[str, Mapping[str, float | None]],
    noise_floor_rad2: float | None,
) -> go.Figure:
    """Steps as the command reports them; references with their held-out error. All errors in rad^2."""
    labels = [f"{number}: {_label(step)}" for number, step in enumerate(steps)]
    hover = [label(", ".join(f"{n} = {value:.4g}" for n, value in step["parameters"].items())) for step in steps]
    figure = go.Figure()
    series = (
        ("fitted motion", "mse_rad2", RESIDUAL, "circle"),
        ("held-out motion", "holdout_mse_rad2", TWIN, "square"),
    )
    for name, key, colour, symbol in series:
        figure.add_trace(
            go.Scatter(
                x=labels,
                y=[step[key] for step in steps],
                name=name,
                mode="lines+markers",
                line={"color": colour, "width": 3},
                marker={"size": 12, "symbol": symbol},
                customdata=hover,
                hovertemplate="%{y:.3g} rad² %{customdata}",
            )
        )
    for key, name, dash in _LINES:
        line = references.get(key, {})
        value = line.get("holdout_mse_rad2") or line.get("mse_rad2")
        if value:
            figure.add_trace(_level(labels, value, name, REFERENCE, dash))
    if noise_floor_rad2:
        figure.add_trace(_level(labels, noise_floor_rad2, "noise floor of the sensors", MEASURED, "solid"))
    figure.update_yaxes(type="log", title_text="mean squared error (rad²)", exponentformat="power")
    figure.update_xaxes(title_text="what was added")
    return styled(figure, label(title), height=620)


def _label(step: Mapping[str, Any]) -> str:
    if step["effect"] is None:
        return "all values<br>together" if step.get("together") else "start"
    return f"{label(step['effect'])}<br>{label(step['target'])}"


def _level(labels: Sequence[str], value: float, name: str, colour: str, dash: str) -> go.Scatter:
    return go.Scatter(
        x=list(labels), y=[value] * len(labels), name=name, mode="lines+markers", marker={"size": 1, "color": colour},
        line={"color": colour, "dash": dash, "width": 1.5}, hovertemplate="%{y:.3g} rad²",
    )  # fmt: skip
