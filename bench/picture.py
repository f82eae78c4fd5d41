"""A figure as a picture for the pages, drawn by the browser that the tests use."""

from __future__ import annotations

import tempfile
from pathlib import Path

import plotly.graph_objects as go

from tests.workbench.browser import Browser, chromium


def picture(figure: go.Figure, path: Path) -> None:
    """Writes a PNG that fills the browser's window; needs a Chromium."""
    figure.update_layout(height=780)
    program = chromium()
    assert program is not None, "no Chromium on this machine"
    with tempfile.TemporaryDirectory() as name:
        page = Path(name) / "figure.html"
        page.write_text(figure.to_html(include_plotlyjs=True, config={"displayModeBar": False}), encoding="utf-8")
        with Browser(program, Path(name) / "profile") as browser:
            tab = browser.open(page.as_uri())
            tab.until("document.querySelectorAll('.main-svg').length > 0 && document.fonts.status === 'loaded'")
            tab.picture(path)
