"""`twin audit`: who asked what of the hand, what was answered, and whether the log is whole."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer

from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import HandName, Json, Model, Namespace
from twin_daemon.cli.run import AUDIT, hand_folder, load_named
from twin_daemon.errors import BadInput

app = Group("The audit log: who asked for what, what was answered, and whether the log is intact.")

File = Annotated[Path | None, typer.Argument(metavar="[FILE]", help="Default: the log of this hand's daemon.")]


@app.command("verify")
def verify(
    file: File = None, hand: HandName = None, model: Model = None, namespace: Namespace = None, json: Json = None
) -> None:
    """Check every line and the chain of hashes. Exit code 3 where it is broken."""
    from twin_daemon.gate import audit

    path = file or _usual(hand, model, namespace)
    found = audit.verify(path)
    emit_json(
        json,
        {
            "path": str(path),
            "entries": found.entries,
            "last": found.last,
            "torn": found.torn,
            "whole": not found.broken,
            "broken": [{"line": one.line, "why": one.why} for one in found.broken],
        },
    )
    if found.broken:
        first = found.broken[0]
        raise BadInput(
            f"the chain is broken in {len(found.broken)} places, first at line {first.line}: {first.why}",
            where=path,
            todo="Keep the file as it is, and compare it with a copy",
        )
    torn = f", {found.torn} torn by a writer that was killed" if found.torn else ""
    if not found.entries:
        people(json).print(f"the audit log is empty, and whole{torn}")
        return
    entries = "1 entry" if found.entries == 1 else f"{found.entries} entries"
    people(json).print(f"{entries}, whole{torn}; the hash of the last is {found.last[:16]}")


@app.command("show")
def show(
    file: File = None,
    count: Annotated[int, typer.Option("--count", metavar="N", min=1, help="How many of the last.")] = 20,
    hand: HandName = None,
    model: Model = None,
    namespace: Namespace = None,
    json: Json = None,
) -> None:
    """The last entries."""
    from twin_daemon.gate import audit

    path = file or _usual(hand, model, namespace)
    entries = list(audit.entries_of(path))[-count:]
    emit_json(json, {"path": str(path), "entries": entries})
    for entry in entries:
        when = datetime.fromtimestamp(int(entry.get("stamp_ns", 0)) * 1e-9, UTC).isoformat(" ", "seconds")
        said = "accepted" if entry.get("accepted") else "refused"
        why = entry.get("why") or entry.get("reason") or ""
        who = entry.get("who") or "unknown"
        people(json).print(plain_text(f"{when}  {who}: {entry.get('verb')} {said} {why}"), soft_wrap=True)


def _usual(hand: str | None, model: Path | None, namespace: str | None) -> Path:
    return hand_folder(load_named(hand, model, namespace).description.namespace) / AUDIT
