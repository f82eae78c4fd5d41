"""What was done to the versions of a hand, in order: one line of JSON a decision, only ever appended.

The number of a decision, not the clock, says what came first. Each line has the sum of its content and of the line
before it. A line that is not whole at the end of the file was never acknowledged; it is dropped by the next writer.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from twin_daemon.errors import BadInput
from twin_daemon.files import sync_folder
from twin_daemon.jsonable import canonical, plain

LAYOUT = 2  # of a hand's folder: 1 had names but no decisions
KINDS = (
    "stored", "named", "unnamed", "promoted", "rolled_back", "rejected", "noted", "pruned", "lost", "checkpoint",
)  # fmt: skip
_TAIL_BYTES = 1 << 16


@dataclass(frozen=True)
class Decision:
    """One step in the life of a hand's versions. `at` is the wall clock (UTC); nothing is ordered by it.

    what         one of KINDS
    version      the version that it is about; after `rolled_back` the one that is current again
    name         the alias that `stored` and `named` set and `unnamed` removes
    text         the note
    removed, stubbed     of `pruned` (and of `lost`, which people accepted)
    promoted, names, versions     of a `checkpoint`: everything as it stood, where earlier lines are not there
    """

    sequence: int
    at: str
    what: str
    version: str | None = None
    name: str | None = None
    text: str | None = None
    removed: tuple[str, ...] = ()
    stubbed: tuple[str, ...] = ()
    promoted: tuple[str, ...] = ()
    names: dict[str, str] = field(default_factory=dict)
    versions: tuple[str, ...] = ()
    before: str = ""

    def as_json(self) -> dict[str, Any]:
        """What is set, with the schema."""
        return {"schema": LAYOUT} | {key: value for key, value in plain(self).items() if value not in (None, [], {})}

    def sum(self) -> str:
        """What the line's own sum must be."""
        return hashlib.sha256(canonical(self.as_json())).hexdigest()[:32]

    def line(self) -> bytes:
        return json.dumps({**self.as_json(), "sum": self.sum()}, ensure_ascii=False).encode() + b"\n"


@dataclass(frozen=True)
class DecisionLog:
    """What a file of decisions holds. `whole_bytes` is where a torn last line begins, if there is one."""

    decisions: tuple[Decision, ...] = ()
    problems: tuple[str, ...] = ()
    whole_bytes: int = 0

    @property
    def last(self) -> Decision | None:
        return self.decisions[-1] if self.decisions else None


def read_decisions(path: Path) -> DecisionLog:
    """Every decision that can be read, and one line for each that cannot. Raises BadInput for a newer release's."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return DecisionLog()
    whole = content.rfind(b"\n") + 1
    decisions: list[Decision] = []
    problems: list[str] = []
    previous: str | None = ""  # None after a line that cannot be read
    for number, line in enumerate(content[:whole].splitlines(), start=1):
        decision = _parsed(line, path)
        if decision is None:
            problems.append(f"{path}: line {number} is not the one that was written")
            previous = None
            continue
        if previous is not None and decision.before != previous:
            problems.append(f"{path}: lines are missing before line {number}")
        previous = decision.sum()
        decisions.append(decision)
    return DecisionLog(tuple(decisions), tuple(problems), whole)


def last_decision(path: Path) -> Decision | None:
    """The last decision; None where there is none, or the last line is torn or damaged. Only the end is read."""
    try:
        with path.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            wanted = _TAIL_BYTES
            while True:
                file.seek(max(0, size - wanted))
                content = file.read()
                if not content.endswith(b"\n"):
                    return None
                _, newline, line = content[:-1].rpartition(b"\n")
                if newline or wanted >= size:
                    return _parsed(line if newline else content[:-1], path)
                wanted *= 4
    except FileNotFoundError:
        return None


def append(path: Path, decision: Decision) -> int:
    """Add a line and make it durable; the size before it. Where that fails the file is as it was."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o644)
    try:
        size = os.fstat(handle).st_size
        line = memoryview(decision.line())
        try:
            while line:
                line = line[os.write(handle, line) :]
            os.fsync(handle)
        except OSError:
            os.ftruncate(handle, size)
            raise
        if not size:
            sync_folder(path.parent)
        return size
    finally:
        os.close(handle)


def cut(path: Path, size: int) -> None:
    """Take back what stands behind the first `size` bytes."""
    with path.open("r+b") as file:
        file.truncate(size)
        os.fsync(file.fileno())


def rechained(decisions: list[Decision]) -> bytes:
    """The file that holds exactly these decisions."""
    content, before = b"", ""
    for decision in decisions:
        linked = dataclasses.replace(decision, before=before)
        content, before = content + linked.line(), linked.sum()
    return content


def refuse_newer(schema: object, newest: int, where: Path) -> None:
    """Raises BadInput where a file was written by a later release than this one."""
    if isinstance(schema, int) and schema > newest:
        raise BadInput(
            f"this was written by a newer release (schema {schema})",
            where=where,
            allowed=f"schema 1 to {newest}",
            todo="Update the package ('twin --version' says which one this is); nothing was changed",
        )


def _parsed(line: bytes, path: Path) -> Decision | None:
    try:
        content = json.loads(line)
        refuse_newer(content.pop("schema"), LAYOUT, path)
        said = content.pop("sum")
        for key in ("removed", "stubbed", "promoted", "versions"):
            if key in content:
                content[key] = tuple(content[key])
        decision = Decision(**content)
    except (ValueError, TypeError, KeyError, AttributeError):
        return None
    return decision if decision.what in KINDS and decision.sum() == said else None
