"""`twin versions verify|prune|backup|restore`: keeping the store sound and small."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import HandName, Json, Model
from twin_daemon.errors import BadInput

if TYPE_CHECKING:
    from twin_daemon.versions import VersionStore


def open_store(hand: str | None, model: Path | None) -> VersionStore:
    """The store of a hand as the options name it."""
    from twin_daemon.hand import load_hand
    from twin_daemon.versions import VersionStore

    return VersionStore.of(load_hand(hand, model))


def verify(
    rebuild: Annotated[
        bool,
        typer.Option(
            "--rebuild", help="Make the index anew, leave out damaged lines of the log, accept what is lost as lost."
        ),
    ] = False,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> int:
    """Check every hash, parent, name and decision against the files. Ends with 3 if something is damaged or gone."""
    from twin_daemon.versions.verify import verify as verified

    found = verified(open_store(hand, model), rebuild=rebuild)
    console = people(json)
    stubs = f", {len(found.stubs)} of them stubs" if found.stubs else ""
    console.print(f"{len(found.intact)} intact{stubs}, {found.decisions} decisions, {len(found.problems)} problems")
    console.print(f"index: {found.index}")
    for line in found.mended:
        console.print(plain_text(line), soft_wrap=True)
    for problem in found.problems:
        console.print(f"[red]damaged[/red] {plain_text(problem)}", soft_wrap=True)
    emit_json(json, found)
    return BadInput.exit_code if found.problems else 0


def prune(
    keep: Annotated[int, typer.Option("--keep", metavar="N", min=0, help="The newest N stay whole.")] = 20,
    older_than: Annotated[
        float, typer.Option("--older-than", metavar="DAYS", min=0.0, help="Only what is older than this may go.")
    ] = 30.0,
    ancestors: Annotated[
        str, typer.Option("--ancestors", metavar="stub|whole", help="How ancestors of what stays are kept.")
    ] = "stub",
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only say what would go.")] = False,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Free space: old versions without a name go; ancestors and what was ever promoted keep their numbers as stubs.

    Current, previous, candidate, the last five promotions and every name of your own stay whole, whatever is asked.
    """
    from twin_daemon.versions.prune import checked, plan
    from twin_daemon.versions.prune import prune as pruned

    store = open_store(hand, model)
    policy = checked(keep, older_than, ancestors)
    choices = plan(store, policy) if dry_run else pruned(store, policy)
    freed = sum(choice.frees_bytes for choice in choices)
    would = "would be " if dry_run else ""
    done = {"remove": f"{would}removed", "stub": f"{would}made a stub"}
    console = people(json)
    for choice in choices:
        if choice.action != "keep":
            console.print(f"{choice.version[:12]} {done[choice.action]} ({choice.why}, {choice.frees_bytes} bytes)")
    kept = sum(choice.action == "keep" for choice in choices)
    console.print(f"{kept} of {len(choices)} stay as they are, {freed} bytes {would}freed")
    emit_json(json, {"hand": store.hand, "dry_run": dry_run, "frees_bytes": freed, "versions": choices})


def backup(
    file: Annotated[Path, typer.Argument(metavar="FILE.tar", help="Where to write it.")],
    replace: Annotated[bool, typer.Option("--replace", help="Replace the file if it exists.")] = False,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> int:
    """Write the versions of every hand (or of --hand) into one plain tar with sums.

    Damaged versions are left out and told, and the command ends with 3.
    """
    from twin_daemon.versions import VersionStore
    from twin_daemon.versions.archive import back_up, hands_with_versions

    every = hand is None and model is None
    stores = [VersionStore(name) for name in hands_with_versions()] if every else [open_store(hand, model)]
    made = back_up(stores, file, replace=replace)
    console = people(json)
    for name, versions in made.hands.items():
        console.print(f"{plain_text(name)}: {len(versions)} versions")
    console.print(f"{plain_text(file)}: {made.bytes} bytes", soft_wrap=True)
    for problem in made.problems:
        console.print(f"[red]left out[/red] {plain_text(problem)}", soft_wrap=True)
    emit_json(json, {"path": file.absolute(), **vars(made)})
    return BadInput.exit_code if made.problems else 0


def restore(
    file: Annotated[Path, typer.Argument(metavar="FILE.tar", help="A file that 'twin versions backup' wrote.")],
    merge: Annotated[bool, typer.Option("--merge", help="Add what is missing here; names stay as they are.")] = False,
    hand: HandName = None,
    model: Model = None,
    json: Json = None,
) -> None:
    """Bring versions back from a backup, of every hand in it or of --hand. What is here already is not overwritten."""
    from twin_daemon.versions.archive import restore as bring_back

    name = None if hand is None and model is None else open_store(hand, model).hand
    restored = bring_back(file, name, merge=merge)
    console = people(json)
    for one in restored:
        console.print(f"{plain_text(one.hand)}: {one.how}, {len(one.versions)} versions")
    emit_json(json, {"path": file.absolute(), "hands": restored})
