"""The residual of one joint over its position and its velocity, apart by direction: friction and play show there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from twin_daemon.comparison.compare import Comparison
from twin_daemon.comparison.conditions import directions, smooth_speed
from twin_daemon.figures.style import DOWN, REFERENCE, UP, label, styled

_BINS = 32
_FEWEST = 3  # samples in a bin of which a median can be told
_WAYS = ((1.0, "moving up", UP, "solid"), (-1.0, "moving down", DOWN, "dash"), (0.0, "hold", REFERENCE, "dot"))


def state_figure(comparisons: Sequence[Comparison], joint: str) -> go.Figure:
    """Median residual (mrad) in bins of position (rad) and of velocity (rad/s), by direction, of all recordings.

    The thin lines are the least and the largest residual in each bin.
    """
    position, speed, residual = _samples(comparisons, joint)
    figure = go.Figure()
    way = directions(speed)
    for sign, name, colour, dash in _WAYS:
        chosen = way == sign
        for x, axis in ((position, "x"), (speed, "x2")):
            if axis == "x" or sign:
                _add_binned(figure, x, residual, chosen, name, colour, dash, axis)
    styled(figure, label(joint), height=260)
    return figure.update_layout(
        hovermode="closest",
        xaxis={"title": "position (rad)", "domain": [0.0, 0.47]},
        xaxis2={"title": "velocity (rad/s)", "domain": [0.53, 1.0], "anchor": "y"},
        yaxis={"title": "residual (mrad)"},
    )


def _samples(comparisons: Sequence[Comparison], joint: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(position rad, speed rad/s, residual mrad) of the known samples of all recordings in which the joint moves."""
    parts = []
    for comparison in comparisons:
        if joint in comparison.joints and comparison.joints[joint].moves:
            column = comparison.aligned.joints.index(joint)
            position = comparison.aligned.measured[:, column]
            known = np.isfinite(position)
            speed = smooth_speed(comparison.aligned.time_s, position)
            parts.append(np.stack([position, speed, 1e3 * comparison.residual[:, column]])[:, known])
    position, speed, residual = np.concatenate(parts, axis=1)
    return position, speed, residual


def _add_binned(
    figure: go.Figure, x: np.ndarray, y: np.ndarray, chosen: np.ndarray, name: str, colour: str, dash: str, axis: str
) -> None:
    if chosen.sum() < _FEWEST or np.ptp(x) == 0:
        return
    edges = np.linspace(x.min(), x.max(), _BINS + 1)
    place = np.clip(np.digitize(x, edges) - 1, 0, _BINS - 1)
    middle, curves = 0.5 * (edges[1:] + edges[:-1]), np.full((3, _BINS), np.nan)
    for index in range(_BINS):
        inside = y[chosen & (place == index)]
        if inside.size >= _FEWEST:
            curves[:, index] = np.min(inside), np.median(inside), np.max(inside)
    styles = ((0, f"{name}, least", 0.6), (2, f"{name}, largest", 0.6), (1, name, 2.4))
    for row, words, width in styles:
        figure.add_trace(
            go.Scatter(
                x=middle.astype(np.float32),
                y=curves[row].astype(np.float32),
                name=words,
                mode="lines+markers" if row == 1 else "lines",
                marker={"size": 4},
                line={"color": colour, "width": width, "dash": dash if row == 1 else "solid"},
                legendgroup=name,
                showlegend=row == 1 and axis == "x",
                xaxis=axis,
                hovertemplate="%{y:.2f} mrad at %{x:.3f}",
            )
        )
