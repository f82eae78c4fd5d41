"""`twin versions`: what was learned of a hand, and which of it is in use."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from twin_daemon.cli import versions_care as care
from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text, require_folder
from twin_daemon.cli.options import HandName, Json, Model
from twin_daemon.cli.versions_care import open_store
from twin_daemon.cli.versions_history import history
from twin_daemon.errors import UsageError
from twin_daemon.workflows.versions import listed

if TYPE_CHECKING:
    from rich.console import Console

    from twin_daemon.versions import Version, VersionStore, Worse

app = Group(help="List, compare, promote, roll back, export, verify and keep what was learned of a hand.")

Reference = Annotated[str, typer.Argument(metavar="VERSION", help="Id, start of an id, alias or shipped name.")]


@app.command("list")
def list_versions(
    tree: Annotated[bool, typer.Option("--tree", help="Draw which version was made from which.")] = False,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Every version of the hand, `nominal` first, then the oldest, with the names that point at it."""
    store = open_store(hand, model)
    found = store.everything()
    versions = store.in_order(found)
    console = people(json)
    if tree:
        console.print(_tree(store, versions))
    else:
        _print_list(console, store, versions, found.stubs)
    if len(versions) == 1:
        console.print(f"No other version of {plain_text(store.hand)} yet. Make one: twin calibrate --recording R...")
    for problem in found.problems:
        console.print(f"[red]damaged[/red] {plain_text(problem)}", soft_wrap=True)
    emit_json(json, listed(store))


@app.command("show")
def show(version: Reference = "current", hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """One version: its parameters, effects, errors and origin."""
    store = open_store(hand, model)
    found = store.get(version)
    console = people(json)
    console.print(f"[bold]{found.short_id}[/bold] {plain_text(_titled(found))}")
    if found.created is not None:
        console.print(f"made {found.created} from {found.parent[:12] if found.parent else 'nominal'}")
    for used, recordings in (("fitted on", found.fitted_on), ("held out", found.held_out_on)):
        if recordings:
            console.print(f"{used}: {plain_text(', '.join(recording.name for recording in recordings))}")
    for name, value in found.errors.items():
        if isinstance(value, dict):
            console.print(f"{plain_text(name)}: {_error(value)} rad²")
    for effect in found.terms.get("effects") or []:
        console.print(f"effect {plain_text(effect.get('effect'))} at {plain_text(effect.get('target'))}")
    notes = store.notes().get(found.id, [])
    for note in notes:
        console.print(f"note of {note.at[:16].replace('T', ' ')}: {plain_text(note.text)}")
    if found.parameters:
        console.print(_parameters(found))
    if found.posterior is not None and found.posterior.names:
        unseen = found.posterior.not_excited
        named = f"; its own recordings say nothing of {plain_text(', '.join(unseen))}" if unseen else ""
        console.print(f"how sure it is of {len(found.posterior.names)} values together: in --json{named}")
    emit_json(json, {**found.as_json(), "names": store.names(found.id), "notes": notes})


@app.command("diff")
def differences(
    before: Reference,
    after: Reference,
    plot: Annotated[Path | None, typer.Option("--plot", metavar="FILE.html", help="Draw what differs.")] = None,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """What changes from one version to another, with intervals."""
    from twin_daemon.versions import diff

    require_folder(json, plot)
    store = open_store(hand, model)
    change = diff(store.get(before), store.get(after))
    if plot is not None:
        from twin_daemon.figures.difference import difference_figure
        from twin_daemon.figures.style import write_page

        names = (f"{reference} ({key[:12]})" for reference, key in ((before, change.before), (after, change.after)))
        write_page(difference_figure(change, *names), plot)
    console = people(json)
    for line in change.words or ("Nothing differs in the terms.",):
        console.print(plain_text(line), soft_wrap=True)
    emit_json(json, {"differences": change, "words": change.words, "plot": plot})


@app.command("promote")
def promote(
    version: Reference = "candidate",
    force: Annotated[
        bool, typer.Option("--force", help="Promote it although it is worse than the version in use; needs --reason.")
    ] = False,
    reason: Annotated[
        str | None, typer.Option("--reason", metavar="TEXT", help="Why, for the log of decisions.")
    ] = None,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Make a version current. What was current becomes previous.

    One that is worse than the version in use, on data that both were tested on, is refused without --force.
    """
    if force and not (reason or "").strip():
        raise UsageError("--force without a reason", todo="Say why with --reason TEXT: it stands in the log")
    store = open_store(hand, model)
    worse = store.worse_than_current(store.get(version))
    promoted = store.promote(version, reason=reason, force=force)
    if worse is not None:
        people(json).print(plain_text(f"worse than what was in use: {worse.words}"), soft_wrap=True)
    _report_move(store, promoted, json, worse)


@app.command("rollback")
def rollback(hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """Make the previous version current again. Before the first promotion the nominal model was in use."""
    store = open_store(hand, model)
    before = store.aliases()["current"]
    version = store.rollback()
    if version.id == before:
        people(json).print("nothing was in use before the nominal model")
    _report_move(store, version, json)


@app.command("reject")
def reject(hand: HandName = None, model: Model = None, json: Json = None) -> None:
    """Decide against the candidate. It stays in the store; no name points at it any more."""
    store = open_store(hand, model)
    version = store.reject()
    people(json).print(f"{version.short_id} is no candidate any more")
    emit_json(json, {"version": version.id, "aliases": store.aliases()})


@app.command("note")
def note(
    version: Reference,
    text: Annotated[str, typer.Argument(metavar="TEXT", help="What people should know of it.")],
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Write a note beside a version. The version itself never changes."""
    store = open_store(hand, model)
    found = store.note(version, text)
    people(json).print(f"noted beside {found.short_id}")
    emit_json(json, {"version": found.id, "notes": store.notes()[found.id]})


@app.command("name")
def name_version(
    name: Annotated[str, typer.Argument(metavar="NAME", help="A name of your own.")],
    version: Annotated[str | None, typer.Argument(metavar="VERSION", help="Without it the name is taken away.")] = None,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Let a name of your own point at a version, which is then never pruned; without VERSION take the name away."""
    store = open_store(hand, model)
    target = store.remove_alias(name) if version is None else store.set_alias(name, version).id
    said = f"is {target[:12]}" if version is not None else f"points at nothing any more (it was {target[:12]})"
    people(json).print(f"{plain_text(name)} {said}")
    emit_json(json, {"name": name, "version": None if version is None else target, "aliases": store.aliases()})


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
    found = open_store(hand, model).export(version, output)
    people(json).print(f"{plain_text(output)}: version {found.short_id} of {plain_text(found.hand)}", soft_wrap=True)
    written = hashlib.sha256(output.read_bytes()).hexdigest()
    emit_json(json, {"version": found.id, "path": output.absolute(), "mjcf_sha256": written})


app.command("verify")(care.verify)
app.command("prune")(care.prune)
app.command("backup")(care.backup)
app.command("restore")(care.restore)
app.command("history")(history)


def _report_move(store: VersionStore, version: Version, json: str | None, worse: Worse | None = None) -> None:
    aliases = store.aliases()
    people(json).print(f"current is {version.short_id} {plain_text(_titled(version))}")
    moved = {"current": aliases["current"], "previous": aliases.get("previous"), "version": version.id}
    emit_json(json, moved if worse is None else {**moved, "worse": worse})


def _titled(version: Version) -> str:
    return f"{version.kind}: {version.title}" if version.title else version.kind


def _error(value: Any) -> str:
    mse = value.get("mse_rad2") if isinstance(value, dict) else value
    return f"{mse:.4g}" if isinstance(mse, (int, float)) else "unknown"


def _tree(store: VersionStore, versions: list[Version]) -> Any:
    from rich.tree import Tree

    from twin_daemon.versions.lineage import gone, tree

    excused = gone(store.decisions().decisions)
    named = store.all_names()
    drawn = Tree(plain_text(store.hand))
    waiting = [(branch, drawn) for branch in tree(versions)]
    for branch, above in waiting:  # grows while it is walked
        version = branch.version
        names = _names(version, named)
        lost = version.parent if above is drawn else None
        origin = f" (from {lost[:12]}, {excused.get(lost, 'not here')})" if lost else ""
        error = _error(version.errors.get("holdout_after") or version.errors.get("after"))
        errors = f", {error} rad²" if version.errors else ""
        label = f"{version.short_id} {plain_text(_titled(version))}{errors}{origin}"
        node = above.add(f"{label} [bold]{plain_text(names)}[/bold]" if names else label)
        waiting += [(child, node) for child in branch.children]
    return drawn


def _print_list(console: Console, store: VersionStore, versions: Sequence[Version], stubs: Collection[str]) -> None:
    """Two lines a version, which fit 80 columns: what it is worth, and what it is called."""
    named, shipped = store.all_names(), store.all_shipped()
    lines = [f"[bold]{'id':14}{'before':>10}{'after':>10}{'held out':>10}  made (UTC)[/]"]
    for version in versions:
        known = (_error(version.errors.get(name)) for name in ("before", "after", "holdout_after"))
        errors = "".join(f"{'-' if error == 'unknown' else error:>10}" for error in known)
        made = "-" if version.created is None else version.created[:16].replace("T", " ")
        names = _names(version, named)
        marks = [f"[bold]{plain_text(names)}[/]"] if names else []
        marks += ["(shipped)"] if version.id in shipped else []
        marks += ["(stub)"] if version.id in stubs else []
        lines += [f"{version.short_id:14}{errors}  {made}", "  " + " ".join([*marks, plain_text(_titled(version))])]
    for line in [*lines, "Errors are mean squared, in rad², each on the data of its own version."]:
        console.print(line, no_wrap=True, overflow="ellipsis", highlight=False)


def _names(version: Version, named: Mapping[str, list[str]]) -> str:
    """Every name that points at a version; a name that is the id says nothing more."""
    return ", ".join(name for name in named.get(version.id, []) if name != version.id)


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
