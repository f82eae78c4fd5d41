"""Tables for people: in a terminal of 80 columns, where names are never cut and words may wrap, and in Markdown."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.table import Table


def slim_table(title: str, headings: Sequence[str], *, words: Sequence[str] = ()) -> Table:
    """A table without side lines. The first column holds names; columns in `words` may wrap, the rest are numbers."""
    from rich import box
    from rich.markup import escape
    from rich.table import Table

    table = Table(title=escape(title), title_justify="left", box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1))
    for index, heading in enumerate(headings):
        wraps = heading in words
        table.add_column(heading, justify="left" if wraps or index == 0 else "right", no_wrap=not wraps)
    return table


def by_kind(names: Sequence[str]) -> Mapping[str, list[str]]:
    """Parameters `place.kind` grouped by their kind, so that a table says the kind and its unit once."""
    kinds: dict[str, list[str]] = {}
    for name in names:
        kinds.setdefault(name.rpartition(".")[2], []).append(name)
    return kinds


def place_of(name: str) -> str:
    """`rh_FFJ3.damping` -> `rh_FFJ3`, indented to stand under its kind."""
    from rich.markup import escape

    return "  " + escape(name.rpartition(".")[0])


def code_cell(text: str) -> str:
    """Code in a cell of a table: with a bar in it, GitHub and Python-Markdown read backticks differently."""
    if "|" not in text:
        return f"`{text}`"
    return f"<code>{html.escape(text, quote=False).replace('|', '&#124;')}</code>"
