"""Is everything here what it was when it was stored? Every hash, every parent, every name, every decision."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from itertools import pairwise

from twin_daemon.errors import BadInput
from twin_daemon.versions.aliases import DamagedNames, read_aliases
from twin_daemon.versions.content_store import Survey
from twin_daemon.versions.decisions import Decision
from twin_daemon.versions.lineage import gone
from twin_daemon.versions.registry import remembered, replay
from twin_daemon.versions.store import VersionStore
from twin_daemon.versions.version import NOMINAL

log = logging.getLogger("twin")


@dataclass(frozen=True)
class Verification:
    """What was found. `index` is fresh, rebuilt, or absent (nothing to hold, or a disk that cannot be written)."""

    hand: str
    intact: tuple[str, ...]
    stubs: tuple[str, ...]
    pruned: tuple[str, ...]
    decisions: int
    index: str
    mended: tuple[str, ...]
    problems: tuple[str, ...]


def verify(store: VersionStore, *, rebuild: bool = False) -> Verification:
    """Read everything and compare. What a dead writer left unfinished is finished first.

    With `rebuild` the index is made anew, damaged lines of the log are left out (the old file stays beside it), and
    versions that are gone for good are taken as lost. Problems are told, never raised.
    """
    mended: tuple[str, ...] = ()
    problems: list[str] = []
    if store.root.is_dir():
        try:
            with store.writing(thorough=True):
                mended = _mend(store) if rebuild else ()
        except BadInput as error:  # a read-only disk, or names that cannot be read: look at what is there
            problems += [error.line()] if rebuild or isinstance(error, DamagedNames) else []
            log.info("%s", error.line())
    found = store.everything(trust=False)
    decided = store.decisions()
    problems += [*found.problems, *decided.problems]
    problems += _lost(store, found, decided.decisions)
    problems += _orphans(store, found, decided.decisions)
    problems += _names(store, found, decided.decisions)
    return Verification(
        hand=store.hand,
        intact=tuple(version.id for version in store.in_order(found) if version.id != NOMINAL),
        stubs=tuple(sorted(found.stubs)),
        pruned=tuple(sorted(key for key, why in gone(decided.decisions).items() if why == "pruned")),
        decisions=len(decided.decisions),
        index=_index(store, found, rebuild),
        mended=mended,
        problems=tuple(dict.fromkeys(problems)),
    )


def _mend(store: VersionStore) -> tuple[str, ...]:
    """What people accept with --rebuild, in words."""
    said = []
    decided = store.decisions()
    if decided.problems:
        store.registry.rewrite()
        said.append(f"{len(decided.problems)} damaged places left out of {store.registry.log_path.name}")
    here = {stored.id for stored in store.contents.own()}
    lost = sorted(remembered(store.decisions().decisions) - here)
    if lost:
        store.registry.decide("lost", removed=tuple(lost))
        said.append(f"taken as lost: {', '.join(version[:12] for version in lost)}")
    return tuple(said)


def _lost(store: VersionStore, found: Survey, decisions: tuple[Decision, ...]) -> list[str]:
    there = {stored.id for stored in store.contents.own()} | found.versions.keys()
    return [
        f"version {version[:12]} was stored and is gone. Restore a backup, or accept it with 'twin versions verify "
        "--rebuild'."
        for version in sorted(remembered(decisions) - there)
    ]


def _orphans(store: VersionStore, found: Survey, decisions: tuple[Decision, ...]) -> list[str]:
    excused = gone(decisions).keys() | {stored.id for stored in store.contents.own()}  # a damaged one is told as such
    return [
        f"version {version.short_id} was made from {version.parent[:12]}, which is not here and was not pruned. "
        "Restore a backup that has it."
        for version in found.versions.values()
        if version.parent and version.parent not in found.versions and version.parent not in excused
    ]


def _names(store: VersionStore, found: Survey, decisions: tuple[Decision, ...]) -> list[str]:
    try:
        stored = read_aliases(store.registry.names_path)
        names = store.registry.aliases()
    except BadInput as error:
        return [error.line()]
    problems = []
    for name, version in names.as_dict().items():
        if version not in found.versions:
            problems.append(
                f"'{name}' points at {version[:12]}, which is damaged or gone. Promote or name another one."
            )
        elif version in found.stubs:
            problems.append(f"'{name}' points at {version[:12]}, whose model was pruned. Restore a backup that has it.")
    if stored is not None and decisions and decisions[-1].sequence == stored.sequence and replay(decisions) != stored:
        whole_log = decisions[0].sequence == 1 and all(
            after.sequence == before.sequence + 1 for before, after in pairwise(decisions)
        )
        if whole_log:
            problems.append(
                f"{store.registry.names_path}: the names are not what was decided. Delete this file: they are worked "
                "out again from the log."
            )
    return problems


def _index(store: VersionStore, found: Survey, rebuild: bool) -> str:
    """The state of the cache; made anew where it does not agree with the files that were just read."""
    own = {stored.id for stored in store.contents.own() if stored.id in found.versions}
    rows = store.index.rows()
    agrees = rows.keys() == own and store.index.sound() and not rebuild
    if agrees:
        return "fresh"
    if not own and not store.root.is_dir():
        return "absent"
    store.index.drop()
    store.everything()
    return "rebuilt" if store.index.rows().keys() == own and own else "absent"
