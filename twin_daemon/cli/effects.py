"""`twin effects`: the library of physical effects, and one of them explained."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.console import emit_json, people
from twin_daemon.cli.options import HandName, Json, Model
from twin_daemon.cli.run import load_named
from twin_daemon.errors import BadInput, UsageError
from twin_daemon.workflows.change import nearest_effect

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.effects.base import Effect
    from twin_daemon.hand import Hand

Key = Annotated[str | None, typer.Argument(metavar="[KEY]", help="Explain this effect.")]


def command(
    key: Key = None,
    plot: Annotated[
        Path | None,
        typer.Option("--plot", metavar="FILE.html", help="Draw what it does to a motion, with and without."),
    ] = None,
    place: Annotated[str, typer.Option("--at", metavar="PLACE", help="Joint or command of the drawing.")] = "",
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """The library of physical effects, cheapest explanation first; with KEY, one effect in full."""
    from twin_daemon.effects import LIBRARY, reload_files

    console = people(json)
    broken = reload_files()
    if plot is not None and key is None:
        raise UsageError("--plot draws one effect", todo="Name it: twin effects KEY --plot FILE.html")
    if key is None:
        _table(console, list(LIBRARY.values()))
        for line in broken.values():
            console.print(f"left out: {line}", markup=False)
        emit_json(json, {"effects": [_plain(effect) for effect in LIBRARY.values()]})
        return
    if key in broken:
        raise BadInput(f"'{key}' cannot be used: {broken[key]}")
    if key not in LIBRARY:
        raise BadInput(f"no effect '{key}'", todo=nearest_effect(key, list(LIBRARY)))
    _explain(console, LIBRARY[key])
    if plot is not None:
        _draw(LIBRARY[key], place, load_named(hand, model, None), plot)
    emit_json(json, {"effect": _plain(LIBRARY[key])})


def _draw(effect: Effect, place: str, hand: Hand, path: Path) -> None:
    from twin_daemon.figures.effect import effect_figure
    from twin_daemon.figures.style import write_page
    from twin_daemon.simulation.signature import signature
    from twin_daemon.simulation.twin import TwinModel

    twin = TwinModel.load(hand)
    target = place or next(
        (name for name in ("hand", *twin.actuators, *twin.joints) if effect.applies(twin.place(name))), ""
    )
    write_page(effect_figure(effect.key, signature(twin, effect.key, target)), path)


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
