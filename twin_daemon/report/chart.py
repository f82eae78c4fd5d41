"""A figure as a page carries it: data without a look, which the page's script gives it by light and dark."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, Literal

import plotly.graph_objects as go
from markupsafe import Markup

SAME = "same"
"""Stands for the times of a figure's first curve; the page's script knows it."""

Kind = Literal["overlay", "plain", "conditions"]


@dataclass(frozen=True)
class Chart:
    """One figure. `words` say what it shows to who cannot see it; figures of one `group` share cursor and zoom."""

    id: str
    words: str
    height: int
    spec: Markup
    kind: Kind = "plain"
    group: str = ""


def chart(
    id: str, figure: go.Figure, words: str, *, kind: Kind = "plain", group: str = "", legend: bool = True
) -> Chart:
    """The figure without its title and template, which the page has of its own."""
    content = json.loads(str(figure.to_json()))
    layout = content["layout"]
    height = int(layout.pop("height", 300))
    layout.pop("template", None)
    layout.pop("title", None)
    layout["margin"] = {"l": 64, "r": 16, "t": 34 if legend else 10, "b": 44}
    layout["showlegend"] = legend
    if kind == "conditions":
        layout["margin"].update(t=52, b=8)
    if kind == "overlay":
        layout["hovermode"] = False  # the page has one cursor over all of them
        _share_times(content["data"])
    return Chart(id, words, height, in_script({"data": content["data"], "layout": layout}), kind, group)


def _share_times(curves: list[dict[str, Any]]) -> None:
    """All curves of an overlay have the same times: they are carried once."""
    for curve in curves[1:]:
        if curve["x"] == curves[0]["x"]:
            curve["x"] = SAME


def in_script(value: object) -> Markup:
    """JSON that can stand in a script element: nothing in it can end the element or begin another."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    for sign in "<>&\u2028\u2029":
        text = text.replace(sign, f"\\u{ord(sign):04x}")
    return Markup(text)
