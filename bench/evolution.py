"""The best error of searches by evaluation, as a picture that a page of Markdown can show."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.picture import picture
from twin_daemon.figures.style import DOWN, REFERENCE, RESIDUAL, TWIN, UP

_LOOK = {
    "random": ("random search", REFERENCE, "--"),
    "pso": ("particle swarm", RESIDUAL, "-."),
    "bayes": ("Gaussian process", UP, ":"),
    "least-squares": ("least squares", TWIN, "-"),
}


def draw(title: str, searches: Mapping[str, Mapping[str, Any]], reported_rad2: float, path: Path) -> None:
    """One line a search; the level is the best error that the dissertation reports."""
    with picture(path) as axes:
        for name, search in searches.items():
            label, colour, style = _LOOK[name]
            evaluations, errors = zip(*search["history"], strict=True)
            axes.step(evaluations, errors, style, where="post", color=colour, label=label, linewidth=1.8)
        axes.axhline(reported_rad2, color=DOWN, linewidth=1.0, label="the dissertation's best")
        axes.set(xscale="log", yscale="log", xlabel="evaluations", ylabel="best error, rad²", title=title)
