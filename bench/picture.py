"""A picture that a page of Markdown can show."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def picture(path: Path, rows: int = 1, height: float = 4.0) -> Iterator[Any]:
    """The axes of a figure, one below the other, with grid and legend once drawn; an SVG at the end of the block."""
    import matplotlib as mpl

    mpl.use("svg")
    from matplotlib import pyplot as plt

    # the same file for the same numbers
    with mpl.rc_context({"svg.hashsalt": path.stem, "svg.fonttype": "none", "font.size": 10}):
        figure, axes = plt.subplots(rows, 1, figsize=(7.5, height), sharex=True, layout="constrained", squeeze=False)
        drawn = axes[:, 0]
        yield drawn if rows > 1 else drawn[0]
        for each in drawn:
            each.grid(True, which="major", alpha=0.3)
            each.legend()
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, format="svg", metadata={"Date": None})
        plt.close(figure)
