"""Which version was made from which."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from twin_daemon.versions.decisions import Decision
from twin_daemon.versions.version import NOMINAL, Version


@dataclass(frozen=True)
class Branch:
    """A version and what was made from it, oldest first."""

    version: Version
    children: tuple[Branch, ...]


def tree(versions: Sequence[Version]) -> tuple[Branch, ...]:
    """Versions (oldest first) as trees; a root is the nominal version, or was made from one that is not among them."""
    known = {version.id for version in versions}
    children: dict[str | None, list[Version]] = {}
    for version in versions:
        parent = None if version.id == NOMINAL else version.parent or NOMINAL
        children.setdefault(parent if parent in known else None, []).append(version)
    built: dict[str, Branch] = {}
    stack = list(children.get(None, ()))
    while stack:  # without recursion: a chain may be longer than Python's stack
        version = stack[-1]
        own = children.get(version.id, [])
        waiting = [child for child in own if child.id not in built]
        if waiting:
            stack += waiting
            continue
        built[version.id] = Branch(version, tuple(built[child.id] for child in own))
        stack.pop()
    return tuple(built[root.id] for root in children.get(None, ()))


def ancestors(version_ids: Iterable[str], versions: Mapping[str, Version]) -> set[str]:
    """Everything that some versions were made from, without themselves."""
    found: set[str] = set()
    waiting = [versions[key].parent for key in version_ids if key in versions]
    while waiting:
        parent = waiting.pop()
        if parent is not None and parent not in found and parent in versions:
            found.add(parent)
            waiting.append(versions[parent].parent)
    return found


def gone(decisions: Iterable[Decision]) -> dict[str, str]:
    """Versions that are not there any more, with what was decided: `pruned` or `lost`."""
    found: dict[str, str] = {}
    for decision in decisions:
        if decision.what in ("pruned", "lost"):
            found |= dict.fromkeys(decision.removed, decision.what)
        elif decision.what == "stored" and decision.version:
            found.pop(decision.version, None)
    return found
