"""What was decided about a hand's versions, and where the names point because of it.

The decisions are the truth, the file of names is what they come to. A decision is appended first and the names follow:
a process that dies in between has decided, and the next writer moves the names. Readers need the names alone.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from datetime import datetime
from functools import reduce
from pathlib import Path
from typing import Any

from twin_daemon.files import leftovers, write_atomically
from twin_daemon.versions.aliases import Aliases, DamagedNames, read_aliases, write_aliases
from twin_daemon.versions.decisions import (
    Decision,
    DecisionLog,
    append,
    cut,
    last_decision,
    read_decisions,
    rechained,
)
from twin_daemon.versions.index import Index
from twin_daemon.versions.locking import NO_SPACE

log = logging.getLogger("twin")

NAMES_FILE, LOG_FILE = "aliases.json", "log.jsonl"


class Registry:
    """The names and the decisions in one hand's folder. Whoever writes holds the lock and settles first."""

    def __init__(self, root: Path, now: Callable[[], datetime], index: Index) -> None:
        self.names_path = root / NAMES_FILE
        self.log_path = root / LOG_FILE
        self._now = now
        self._index = index

    # -- reading

    def aliases(self) -> Aliases:
        """Where the names point. Damaged or missing names are worked out from the decisions. Raises BadInput."""
        try:
            found = read_aliases(self.names_path)
        except DamagedNames as damaged:
            return self._replayed(damaged)
        return self._replayed(None) if found is None else found

    def decisions(self) -> DecisionLog:
        """Everything that was decided, in order."""
        return read_decisions(self.log_path)

    def _replayed(self, damaged: DamagedNames | None) -> Aliases:
        decided = self.decisions()
        if decided.last is None:
            if damaged is not None:
                raise damaged
            return Aliases()
        level = logging.DEBUG if damaged is None else logging.WARNING
        log.log(level, "%s: cannot be read; the names are worked out from %s", self.names_path, self.log_path.name)
        return replay(decided.decisions)

    # -- writing

    def decide(self, what: str, **content: Any) -> None:
        """Make a decision durable and move the names. Where that fails nothing was decided.

        On a full disk the index is given up to make room: going back must be possible then, too.
        """
        try:
            self._decide(what, content)
        except OSError as error:
            if error.errno not in NO_SPACE or not self._index.drop():
                raise
            self._decide(what, content)

    def _decide(self, what: str, content: dict[str, Any]) -> None:
        aliases, last = self.aliases(), last_decision(self.log_path)
        decision = Decision(
            sequence=max(aliases.sequence, last.sequence if last else 0) + 1,
            at=self._now().isoformat(timespec="microseconds"),
            what=what,
            **content,
        )
        size = append(self.log_path, decision)
        try:
            write_aliases(self.names_path, aliases.after(decision))
        except OSError:
            cut(self.log_path, size)
            raise

    def settle(self, stored: Callable[[], Sequence[str]], *, thorough: bool) -> None:
        """Finish what a dead writer began, and take over a folder of an earlier layout.

        `stored` gives the ids that have a folder here, oldest first; it is called only where they matter.
        """
        for half in leftovers(self.names_path):
            half.unlink(missing_ok=True)
        last = last_decision(self.log_path)
        if not thorough and last is not None and self._names_follow(last):
            return
        decided = self.decisions()
        if self.log_path.exists() and self.log_path.stat().st_size > decided.whole_bytes:
            cut(self.log_path, decided.whole_bytes)
        aliases = self.aliases()
        present = stored()
        if decided.last is None or decided.last.sequence < aliases.sequence:
            if present or aliases != Aliases():
                self.decide("checkpoint", promoted=aliases.promoted, names=aliases.names, versions=tuple(present))
            return
        caught_up = reduce(Aliases.after, (d for d in decided.decisions if d.sequence > aliases.sequence), aliases)
        if not self._names_follow(decided.last):
            write_aliases(self.names_path, caught_up)
        known = remembered(decided.decisions)
        for version in present:
            if version not in known:
                self.decide("stored", version=version)

    def rewrite(self) -> None:
        """Leave out the lines that cannot be read, and say where everything stands. The damaged file is kept."""
        decided, aliases = self.decisions(), self.aliases()
        present = sorted(remembered(decided.decisions))
        kept = self.log_path.with_name(f"{LOG_FILE}.damaged-{aliases.sequence}")
        write_atomically(kept, self.log_path.read_bytes())
        last = max(aliases.sequence, decided.last.sequence if decided.last else 0)
        checkpoint = Decision(
            sequence=last + 1,
            at=self._now().isoformat(timespec="microseconds"),
            what="checkpoint",
            promoted=aliases.promoted,
            names=aliases.names,
            versions=tuple(present),
        )
        write_atomically(self.log_path, rechained([*decided.decisions, checkpoint]))
        write_aliases(self.names_path, aliases.after(checkpoint))

    def _names_follow(self, last: Decision) -> bool:
        try:
            aliases = read_aliases(self.names_path)
        except DamagedNames:
            return False
        return aliases is not None and aliases.sequence == last.sequence


def replay(decisions: Sequence[Decision]) -> Aliases:
    """The names that decisions come to."""
    return reduce(Aliases.after, decisions, Aliases())


def remembered(decisions: Sequence[Decision]) -> set[str]:
    """The versions that must be there."""
    there: set[str] = set()
    for decision in decisions:
        if decision.what == "stored" and decision.version:
            there.add(decision.version)
        there |= set(decision.versions)
        if decision.what in ("pruned", "lost"):
            there -= set(decision.removed)
    return there


def order(decisions: Sequence[Decision]) -> dict[str, tuple[int, int]]:
    """When each version was stored first, as something to sort by that no clock has a part in."""
    first: dict[str, tuple[int, int]] = {}
    for decision in decisions:
        stored = (decision.version,) if decision.what == "stored" and decision.version else decision.versions
        for position, version in enumerate(stored):
            first.setdefault(version, (decision.sequence, position))
    return first
