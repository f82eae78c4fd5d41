"""`twin effects`: the library of physical effects, and one of them explained."""

from __future__ import annotations

import difflib
from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.console import emit_json, people
from twin_daemon.cli.options import Json
from twin_daemon.errors import BadInput, nearest

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.effects.base import Effect

Key = Annotated[str | None, typer.Argument(metavar="[KEY]", help="Explain this effect.")]


def command(key: Key = None, json: Json = None) -> None:
    """The library of physical effects, cheapest explanation first; with KEY, one effect in full."""
    from twin_daemon.effects import LIBRARY

    console = people(json)
    if key is None:
        _table(console, list(LIBRARY.values()))
        emit_json(json, {"effects": [_plain(effect) for effect in LIBRARY.values()]})
        return
    if key not in LIBRARY:
        raise BadInput(f"no effect '{key}'", todo=nearest_effect(key, list(LIBRARY)))
    _explain(console, LIBRARY[key])
    emit_json(json, {"effect": _plain(LIBRARY[key])})


def nearest_effect(key: str, known: list[str]) -> str:
    """As `nearest`, also for half a key: 'stribek' is near to 'stribeck_friction'."""
    halves = {half: name for name in reversed(known) for half in (name, *name.split("_"))}
    close = difflib.get_close_matches(key, halves, n=1, cutoff=0.7)
    return f"Did you mean '{halves[close[0]]}'?" if close else nearest(key, known)


def _plain(effect: Effect) -> dict[str, Any]:
    return {
        "key": effect.key,
        "title": effect.title,
        "acts_on": effect.acts_on,
        "parameters": {
            p.name: {name: value for name, value in asdict(p).items() if name != "name"} for p in effect.parameters
        },
        **asdict(effect.story),
        "confusable_with": list(effect.confusable),
        "contains": list(effect.contains),
    }


def _table(console: Console, effects: list[Effect]) -> None:
    from rich.table import Table

    table = Table(title="Effects, cheapest explanation first")
    for column in ("key", "what it is", "acts on", "parameters"):
        table.add_column(column, no_wrap=column == "key")
    for effect in effects:
        names = ", ".join(f"{p.name} ({p.unit})" if p.unit != "1" else p.name for p in effect.parameters)
        table.add_row(effect.key, effect.title, effect.acts_on, names)
    console.print(table)
    console.print("twin effects KEY explains one; twin add KEY --joint J adds it to the twin.", markup=False)


def _explain(console: Console, effect: Effect) -> None:
    from rich.table import Table

    console.print(f"[bold]{effect.key}[/]: {effect.title}")
    for label, text in (
        ("What it is", effect.story.what),
        ("In the data", effect.story.shows),
        ("Causes", effect.story.cause),
        ("What to do", effect.story.remedy),
        ("Motion that tells", effect.story.excitation),
        ("Easily taken for", ", ".join(effect.confusable) or "nothing else"),
        ("Becomes, at a bound", ", ".join(effect.contains)),
    ):
        if text:
            console.print(f"  [dim]{label}:[/] {text}")
    table = Table()
    for column in ("parameter", "unit", "lower", "upper", "no effect at", "typical", "meaning"):
        table.add_column(column, no_wrap=column == "parameter")
    for p in effect.parameters:
        numbers = [f"{number:g}" for number in (p.lower, p.upper, p.neutral, p.default)]
        table.add_row(p.name, p.unit, *numbers, p.meaning + (" (not fitted)" if p.held else ""))
    console.print(table)
