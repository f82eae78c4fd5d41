"""One drawing for each effect: a mechanism between motor and joint, or its law as a curve.

The files of `drawings/` are their one home: the page of the workbench and the report show them, each with colours of
its own for the classes `part` (what every joint has), `good` (the effect), `bad`, `model` (without it), `axis`,
`thick` and `words`.
"""

from __future__ import annotations

import html
from pathlib import Path

FOLDER = Path(__file__).with_name("drawings")
_UNKNOWN = "unknown"


def drawing(key: str, title: str) -> str:
    """The SVG of an effect, to stand in a page; an effect that nobody has drawn gets a joint with a question mark."""
    drawn = {path.stem: path for path in FOLDER.glob("*.svg")}
    source = drawn.get(key, drawn[_UNKNOWN]).read_text(encoding="utf-8")
    said = f'role="img" aria-label="Drawing: {html.escape(title)}" data-effect="{html.escape(key)}"'
    return source.replace("<svg ", f'<svg class="drawing" {said} ', 1)
