"""`docs/cli.md`, made of the commands themselves: it lists what `--help` of each would say."""

from __future__ import annotations

import html
import inspect
from collections import Counter
from collections.abc import Iterator
from typing import Any

import typer
from typer.core import TyperArgument, TyperGroup

from twin_daemon.cli.app import COMMANDS, LIVE, OFFLINE, STATE, load
from twin_daemon.tables import code_cell

_HEAD = """\
# Command line

This page is made by `twin config cli -o docs/cli.md`, from the commands themselves.

`make setup` puts the program at `.venv/bin/twin`. Without options the commands use the Shadow Hand on loopback, and
those that run side by side find each other in any start order. An option that takes several values can be repeated or
listed: `--recording a.mcap b.mcap`. Versions, recordings and the audit log are in the platform's state folder, or in
`TWIN_STATE_DIR`.

A recording is a ROS 1 bag, a ROS 2 bag (sqlite3 or MCAP) or CSV, with measured `joint_states` and what was commanded
([data and units](data-and-units.md)).

`--json PATH` writes the result as one JSON object; `-` is standard output ([JSON](json.md)).

| exit code | meaning |
|---|---|
| 0 | done |
| 1 | a bug; the line on standard error says where its details are |
| 2 | wrong usage |
| 3 | bad input; one line says what, where, what is allowed and what to do |
| 4 | refused by the safety gate |
| 5 | nothing answered |
| 130 | interrupted |
"""
_SHARED_BY = 5
"""From so many commands on an option is explained once, in a table of its own."""

_MORE = {
    "run": "operations.md",
    "gate": "safety.md",
    "hand": "tutorial.md",
    "record": "recording.md",
    "bridge": "ros2.md",
    "command": "safety.md",
    "consent": "hazards.md",
    "workbench": "workbench.md",
    "audit": "safety.md",
    "fleet": "operations.md#several-hands-one-router",
    "query": "operations.md",
    "calibrate": "tutorial.md",
    "recalibrate": "operations.md",
    "diagnose": "diagnosis.md",
    "propose": "proposals.md",
    "add": "diagnosis.md#add-remove-ladder",
    "remove": "diagnosis.md#add-remove-ladder",
    "ladder": "diagnosis.md#add-remove-ladder",
    "report": "report.md",
    "effects": "add-an-effect.md",
    "security": "security.md",
    "service": "install.md",
    "config": "configuration.md",
    "versions": "versions.md",
}
"""The page that says more of a command."""

_Option = tuple[str, str]  # how it is written, what it means


def page() -> str:
    """The page as Markdown."""
    commands = {name: load(name) for name in COMMANDS}
    leaves = [leaf for name, command in commands.items() for leaf in _leaves(f"twin {name}", command)]
    counted = Counter(option for _, leaf in leaves for option in _options(leaf))
    shared = [option for option, times in counted.items() if times >= _SHARED_BY]
    parts = [_HEAD]
    for panel in (OFFLINE, LIVE, STATE):
        parts.append(_overview(panel))
    parts.append("\n## Shared options\n\n" + _table("option", shared))
    for panel in (OFFLINE, LIVE, STATE):
        for name, entry in COMMANDS.items():
            if entry.panel == panel:
                parts.append(_section(name, commands[name], shared))
    return "".join(parts)


def _overview(panel: str) -> str:
    text = f"\n## {panel}\n\n| command | what it does | more |\n|---|---|---|\n"
    for name, entry in COMMANDS.items():
        if entry.panel == panel:
            more = f"[{_MORE[name].partition('.')[0]}]({_MORE[name]})" if name in _MORE else ""
            text += f"| [`twin {name}`](#twin-{name}) | {_plain(entry.help)} | {more} |\n"
    return text


def _section(name: str, command: Any, shared: list[_Option]) -> str:
    text = f"\n## `twin {name}`\n\n"
    if not isinstance(command, TyperGroup):
        return text + _command(f"twin {name}", command, shared)
    text += _said(command)
    for full, leaf in _leaves(f"twin {name}", command):
        text += f"\n### `{full}`\n\n" + _command(full, leaf, shared)
    return text


def _command(full: str, command: Any, shared: list[_Option]) -> str:
    own, common = [], []
    for option in _options(command):
        (common if option in shared else own).append(option)
    usage = " ".join([full, *_needed(command), *(["[OPTIONS]"] if own or common else [])])
    text = f"```text\n{usage}\n```\n\n{_said(command)}"
    if own:
        text += "\n" + _table("option", own)
    if common:
        text += f"\n[Shared](#shared-options): {', '.join(code_cell(written) for written, _ in common)}.\n"
    return text


def _leaves(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    """(name in full, command) of a command, or of each one in a group."""
    if isinstance(command, TyperGroup):
        for short, below in command.commands.items():
            yield from _leaves(f"{name} {short}", below)
    else:
        yield name, command


def _options(command: Any) -> list[_Option]:
    """How each argument and option that is explained is written, and its meaning with default and bounds."""
    context = typer.Context(command)
    found = []
    for one in command.params:
        record = one.get_help_record(context)  # None for what is hidden
        if record is not None and (record[1] or not isinstance(one, TyperArgument)):
            found.append((_written(one) if isinstance(one, TyperArgument) else record[0], _meaning(record[1])))
    return found


def _needed(command: Any) -> list[str]:
    """The arguments, and the options that must be given."""
    context = typer.Context(command)
    return [
        _written(one) if isinstance(one, TyperArgument) else one.get_help_record(context)[0]
        for one in command.params
        if isinstance(one, TyperArgument) or one.required
    ]


def _written(argument: Any) -> str:
    written = argument.metavar or argument.name.upper()
    return written if argument.required or written.startswith("[") else f"[{written}]"


def _meaning(said: str) -> str:
    """`Text.  [default: 3; x>=1]` -> `Text. (default: 3; x ≥ 1)`. What is required stands in the usage."""
    if not said.endswith("]") or "[" not in said:
        return said
    text, _, limits = said.removesuffix("]").rpartition("[")
    kept = [part for part in limits.split("; ") if part != "required"]
    limits = "; ".join(kept).replace("<=", " ≤ ").replace(">=", " ≥ ")
    return f"{text.strip()} ({limits})".strip() if kept else text.strip()


def _said(command: Any) -> str:
    return _plain(inspect.cleandoc(command.help or "")) + "\n"


def _table(title: str, options: list[_Option]) -> str:
    rows = "".join(f"| {code_cell(written)} | {_plain(meaning)} |\n" for written, meaning in options)
    return f"| {title} | meaning |\n|---|---|\n{rows}"


def _plain(text: str) -> str:
    """Help as Markdown: what would be taken for a tag or a link is text."""
    return html.escape(text, quote=False).replace("[", "\\[").replace("|", "&#124;")
