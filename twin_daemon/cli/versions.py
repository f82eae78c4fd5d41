"""`twin versions`: what was learned of a hand, and which of it is in use."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import HandName, Json, Model
from twin_daemon.errors import BadInput

if TYPE_CHECKING:
    from twin_daemon.versions import Version, VersionStore

app = Group(help="List, compare, promote, roll back, export and verify what was learned of a hand.")

Reference = Annotated[str, typer.Argument(metavar="VERSION", help="Id, start of an id, alias or shipped name.")]


@app.command("list")
def list_versions(hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """Every version of the hand, oldest first, with the names that point at it."""
    store = _store(hand, model)
    versions, problems = store.survey()
    console = people(json)
    if versions:
        console.print(_table(store, versions))
    else:
        console.print(f"No versions of {plain_text(store.hand)} yet. Make one: twin calibrate --recording R...")
    for problem in problems:
        console.print(f"[red]damaged[/red] {plain_text(problem)}", soft_wrap=True)
    rows = [
        {**_summary(version), "names": store.names(version.id), "shipped": store.shipped(version.id)}
        for version in versions
    ]
    emit_json(json, {"hand": store.hand, "versions": rows, "aliases": store.aliases(), "problems": problems})


@app.command("show")
def show(version: Reference = "current", hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """One version: its parameters, effects, errors and origin."""
    store = _store(hand, model)
    found = store.get(version)
    console = people(json)
    console.print(f"[bold]{found.short_id}[/bold] {plain_text(_titled(found))}")
    console.print(f"made {found.created} from {found.parent[:12] if found.parent else 'the nominal model'}")
    for used, recordings in (("fitted on", found.fitted_on), ("held out", found.held_out_on)):
        if recordings:
            console.print(f"{used}: {plain_text(', '.join(recording.name for recording in recordings))}")
    for name, value in found.errors.items():
        console.print(f"{plain_text(name)}: {_error(value)} rad²")
    for effect in found.terms.get("effects") or []:
        console.print(f"effect {plain_text(effect.get('effect'))} at {plain_text(effect.get('target'))}")
    if found.parameters:
        console.print(_parameters(found))
    emit_json(json, {**found.as_json(), "names": store.names(found.id)})


@app.command("diff")
def differences(
    before: Reference, after: Reference, hand: HandName = None, model: Model = None, json: Json = None
) -> None:
    """What changes from one version to another, with intervals."""
    from twin_daemon.versions import diff

    store = _store(hand, model)
    change = diff(store.get(before), store.get(after))
    console = people(json)
    for line in change.words or ("Nothing differs in the terms.",):
        console.print(plain_text(line), soft_wrap=True)
    emit_json(json, {"differences": change, "words": change.words})


@app.command("promote")
def promote(version: Reference = "candidate", hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """Make a version current. What was current becomes previous."""
    store = _store(hand, model)
    _report_move(store, store.promote(version), json)


@app.command("rollback")
def rollback(hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """Make the previous version current again."""
    store = _store(hand, model)
    _report_move(store, store.rollback(), json)


@app.command("export")
def export(
    version: Reference = "current",
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE.xml", help="Where to write the MJCF.")] = Path(
        "twin.xml"
    ),
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Write one plain MJCF that MuJoCo loads without this package."""
    found = _store(hand, model).export(version, output)
    people(json).print(f"{plain_text(output)}: version {found.short_id} of {plain_text(found.hand)}", soft_wrap=True)
    emit_json(json, {"version": found.id, "path": output.absolute(), "mjcf_sha256": found.mjcf_sha256})


@app.command("verify")
def verify(hand: HandName = None, model: Model = None, json: Json = None) -> int:
    """Check every stored version against its hashes. Ends with 3 if one is damaged."""
    versions, problems = _store(hand, model).survey()
    console = people(json)
    console.print(f"{len(versions)} intact, {len(problems)} damaged")
    for problem in problems:
        console.print(f"[red]damaged[/red] {plain_text(problem)}", soft_wrap=True)
    emit_json(json, {"intact": [version.id for version in versions], "problems": problems})
    return BadInput.exit_code if problems else 0


def _store(hand: str | None, model: Path | None) -> VersionStore:
    from twin_daemon.hand import load_hand
    from twin_daemon.versions import VersionStore

    return VersionStore(load_hand(hand, model).name)


def _report_move(store: VersionStore, version: Version, json: str | None) -> None:
    aliases = store.aliases()
    people(json).print(f"current is {version.short_id} {plain_text(_titled(version))}")
    emit_json(json, {"current": aliases.get("current"), "previous": aliases.get("previous"), "version": version.id})


def _summary(version: Version) -> dict[str, Any]:
    return version.model_dump(
        include={"id", "kind", "title", "created", "parent", "errors", "fitted_on", "held_out_on"}, mode="json"
    )


def _titled(version: Version) -> str:
    return f"{version.kind}: {version.title}" if version.title else version.kind


def _error(value: Any) -> str:
    mse = value.get("mse_rad2") if isinstance(value, dict) else value
    return f"{mse:.4g}" if isinstance(mse, (int, float)) else "unknown"


def _table(store: VersionStore, versions: list[Version]) -> Any:
    from rich.table import Table

    table = Table(box=None)
    table.add_column("id", no_wrap=True)
    for title in ("names", "kind", "before", "after", "held out"):
        table.add_column(title)
    table.add_column("made (UTC)", no_wrap=True)
    for version in versions:
        errors = [_error(version.errors.get(name)) for name in ("before", "after", "holdout_after")]
        names = ", ".join(store.names(version.id)) + (" (shipped)" if store.shipped(version.id) else "")
        made = version.created[:16].replace("T", " ")
        table.add_row(version.short_id, plain_text(names), plain_text(_titled(version)), *errors, made)
    table.caption = "Errors are mean squared, in rad²."
    return table


def _parameters(version: Version) -> Any:
    from rich.table import Table

    table = Table("parameter", "value", "95 % interval", "unit", "bounds", "identifiable", box=None)
    for name, parameter in version.parameters.items():
        interval = "unknown" if parameter.ci95 is None else f"{parameter.ci95[0]:.3g} to {parameter.ci95[1]:.3g}"
        bounds = f"{_plain_number(parameter.lower)} to {_plain_number(parameter.upper)}"
        table.add_row(
            plain_text(name),
            _plain_number(parameter.value),
            interval,
            plain_text(parameter.unit),
            bounds + (" (at bound)" if parameter.at_bound else ""),
            _yes_no(parameter.identifiable),
        )
    return table


def _plain_number(value: float | None) -> str:
    return "unknown" if value is None else f"{value:.4g}"


def _yes_no(value: bool | str | None) -> str:
    if isinstance(value, str):
        return plain_text(value)
    return "unknown" if value is None else ("yes" if value else "no")
