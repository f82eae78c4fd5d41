"""What was done to the versions of a hand, in order: a journal with one decision a line.

The number of a decision, not the clock, says what came first. A line that is not whole at the end of the file was never
acknowledged; it is dropped by the next writer. The lines of an earlier release (schema 2) had sums of their own.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from twin_daemon.errors import BadInput
from twin_daemon.journal import Journal, Line, chained, last_line, lines
from twin_daemon.jsonable import canonical, plain

LAYOUT = 2  # of the file of names: 1 had names but no decisions
_LINES = 3  # of the decisions
KINDS = (
    "stored", "named", "unnamed", "promoted", "rolled_back", "rejected", "noted", "pruned", "lost", "checkpoint",
)  # fmt: skip


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

    def as_json(self) -> dict[str, Any]:
        """What is set, with the schema."""
        return {"schema": _LINES} | {key: value for key, value in plain(self).items() if value not in (None, [], {})}


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
    decisions: list[Decision] = []
    problems: list[str] = []
    end = whole_bytes = 0
    old_sum, after_damage = "", False
    try:
        for line in lines(path):
            end += len(line.raw) + 1
            if line.torn:
                continue
            whole_bytes = end
            decision = _parsed(line, path)
            if decision is None:
                problems.append(f"{path}: line {line.number} is not the one that was written")
            else:
                if not after_damage and not _follows(line, old_sum):
                    problems.append(f"{path}: lines are missing before line {line.number}")
                decisions.append(decision)
            after_damage = decision is None
            old_sum = (line.content or {}).get("sum", "")
    except FileNotFoundError:
        return DecisionLog()
    return DecisionLog(tuple(decisions), tuple(problems), whole_bytes)


def last_decision(path: Path) -> Decision | None:
    """The last decision; None where there is none, or the last line is torn or damaged. Only the end is read."""
    line = last_line(path)
    return None if line is None else _parsed(line, path)


def append(path: Path, decision: Decision) -> int:
    """Add a line and make it durable; the size before it. Where that fails the file is as it was."""
    with Journal(path) as journal:
        return journal.append(decision.as_json(), durable=True)


def cut(path: Path, size: int) -> None:
    """Take back what stands behind the first `size` bytes."""
    with path.open("r+b") as file:
        file.truncate(size)
        os.fsync(file.fileno())


def rechained(decisions: list[Decision]) -> bytes:
    """The file that holds exactly these decisions."""
    return chained(decision.as_json() for decision in decisions)


def refuse_newer(schema: object, newest: int, where: Path) -> None:
    """Raises BadInput where a file was written by a later release than this one."""
    if isinstance(schema, int) and schema > newest:
        raise BadInput(
            f"this was written by a newer release (schema {schema})",
            where=where,
            allowed=f"schema 1 to {newest}",
            todo="Update the package ('twin --version' says which one this is); nothing was changed",
        )


def _parsed(line: Line, path: Path) -> Decision | None:
    content = dict(line.content or {})
    refuse_newer(content.get("schema"), _LINES, path)
    if line.entry is None or not (_is_new(content) or content.get("sum") == _old_sum(content)):
        return None
    content = {key: value for key, value in line.entry.items() if key not in ("schema", "sum", "before")}
    for key in ("removed", "stubbed", "promoted", "versions"):
        if key in content:
            content[key] = tuple(content[key])
    try:
        decision = Decision(**content)
    except TypeError:
        return None
    return decision if decision.what in KINDS else None


def _follows(line: Line, old_sum: str) -> bool:
    content = line.content or {}
    return line.follows if _is_new(content) else content.get("before") == old_sum


def _is_new(content: dict[str, Any]) -> bool:
    return content.get("schema") == _LINES and "prev" in content and "sum" in content


def _old_sum(content: dict[str, Any]) -> str:
    """The sum of a line of schema 2: of its content in one spelling."""
    return hashlib.sha256(canonical({key: value for key, value in content.items() if key != "sum"})).hexdigest()[:32]
