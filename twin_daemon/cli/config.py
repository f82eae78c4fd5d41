"""`twin config`: is this configuration right, what does it come to, and what may stand in it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Json, Output

app = Group("The daemon's configuration: checked, shown with where each value came from, explained.")

File = Annotated[
    Path | None,
    typer.Argument(metavar="[FILE]", help="The file of 'twin run -c'; none: defaults and environment."),
]


@app.command("check")
def check(file: File = None, json: Json = None) -> None:
    """Whether the daemon would take it: every key known, every value allowed, its hand there. Exit code 3 if not."""
    from twin_daemon.daemon.configuration import load_config
    from twin_daemon.gate.limits import limits_of
    from twin_daemon.hand import load_hand

    effective = load_config(file, os.environ)
    limits_of(load_hand(effective.config.hand, effective.config.model), effective.config.gate)
    emit_json(json, {"path": None if file is None else str(file), "valid": True, "sources": effective.sources})
    set_here = len(effective.sources)
    people(json).print(f"valid: {set_here} {'key is' if set_here == 1 else 'keys are'} set, all others are defaults")


@app.command("show")
def show(file: File = None, json: Json = None) -> None:
    """What the daemon would go by: each value, and whether it is a default, the file's or the environment's."""
    from twin_daemon.daemon.configuration import OTHER_VARIABLES, load_config, shown

    rows = shown(load_config(file, os.environ))
    others = {name: os.environ[name] for name in OTHER_VARIABLES if os.environ.get(name)}
    console, width = people(json), max(len(key) for key, _, _ in rows)
    for key, value, source in [*rows, *((name, value, "environment") for name, value in others.items())]:
        line = f"{key:<{width}}  {'-' if value is None else str(value):<24}  {source}"
        console.print(plain_text(line), soft_wrap=True)
    keys = {key: {"value": value, "from": source} for key, value, source in rows}
    emit_json(json, {"path": None if file is None else str(file), "keys": keys, "variables": others})


@app.command("docs")
def docs(output: Output = None) -> None:
    """Every key with its meaning, unit, bounds and default, as a page of Markdown."""
    from twin_daemon.daemon.config_page import page

    _write(output, page())


@app.command("thresholds")
def thresholds(output: Output = None) -> None:
    """Every number that a fit or a diagnosis decides by, with its unit and its origin, as a page of Markdown."""
    from twin_daemon.changes import thresholds as of_changes
    from twin_daemon.diagnosis.threshold_page import page
    from twin_daemon.proposals import thresholds as of_proposals

    _write(output, page(("Changes since an earlier session", of_changes), ("Proposals", of_proposals)))


@app.command("cli")
def cli(output: Output = None) -> None:
    """Every command with its options, as a page of Markdown."""
    from twin_daemon.cli.reference_page import page

    _write(output, page())


def _write(output: Path | None, text: str) -> None:
    from twin_daemon.files import write_atomically

    if output is None:
        typer.echo(text, nl=False)
    else:
        write_atomically(output, text.encode())
