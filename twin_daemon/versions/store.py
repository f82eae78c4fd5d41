"""The versions of one hand: immutable folders, a log of what was decided about them, and names that move.

A version is written into a hidden folder beside the others, made durable, and renamed into place; then the decision is
logged, then the names move. A process that is killed at any moment leaves the old state or the new one, and what the
next writer finishes or removes. Readers need no lock; writers hold one, which the kernel releases when they die.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from twin_daemon.errors import BadInput, nearest
from twin_daemon.files import write_atomically
from twin_daemon.resources import models_dir, state_dir
from twin_daemon.versions.aliases import CANDIDATE, CURRENT, PREVIOUS
from twin_daemon.versions.content_store import ID, NAME, ContentStore, Stored, Survey
from twin_daemon.versions.decisions import DecisionLog
from twin_daemon.versions.index import Index
from twin_daemon.versions.locking import locked, machine_errors
from twin_daemon.versions.registry import Registry, order
from twin_daemon.versions.standing import Worse, known_errors, worse_than
from twin_daemon.versions.version import NOMINAL, Draft, Version, nominal, seal

if TYPE_CHECKING:
    from twin_daemon.hand import Hand

SHORTEST_PREFIX = 4
HANDS = "hands"


@dataclass(frozen=True)
class Note:
    """What a person wrote beside a version. `at` is UTC."""

    at: str
    text: str


@dataclass(frozen=True)
class Proposed:
    """A stored version, and whether it is the candidate now."""

    version: Version
    candidate: bool


class VersionStore:
    """Versions of the hand called `hand`, stored under `root` (default: the state folder), the shipped ones, and
    `nominal`, the model as described, which is in use while nothing else is and which no folder holds.

    `now` is the clock that decisions and versions are stamped with (UTC); nothing is ordered by it. `described` gives
    the MJCF text of the nominal model; `VersionStore.of` knows it.
    """

    def __init__(
        self,
        hand: str,
        root: Path | None = None,
        shipped: Path | None = None,
        now: Callable[[], datetime] = lambda: datetime.now(UTC),
        described: Callable[[], str] | None = None,
    ) -> None:
        if not NAME.fullmatch(hand):
            raise BadInput(f"'{hand}' cannot name a folder of versions", allowed="letters, digits and _.-")
        self.hand = hand
        self.root = root if root is not None else state_dir() / HANDS / hand
        self.now = now
        self._described = described
        self.index = Index(self.root)
        self.registry = Registry(self.root, now, self.index)
        self.contents = ContentStore(
            hand,
            self.root / "versions",
            shipped if shipped is not None else models_dir() / hand / "versions",
            self.index,
        )

    @classmethod
    def of(cls, hand: Hand) -> VersionStore:
        """The versions of a hand in the state folder."""

        def described() -> str:
            from twin_daemon.simulation.twin import TwinModel  # only who asks for the model needs the engine

            return TwinModel.load(hand).mjcf()

        return cls(hand.name, described=described)

    # -- writing

    def add(self, draft: Draft, mjcf: str, *, alias: str | None = None) -> Version:
        """Store a version and, if asked, let `alias` (usually `candidate`) point at it.

        The same content always gets the same id; adding it again stores nothing new. When this returns, the version
        survives a loss of power. Raises BadInput where the disk is full or cannot be written; then nothing was stored.
        """
        version = seal(draft, mjcf, self.now())
        if alias is not None:
            _must_be_free(alias)
        with self.writing(), self.contents.putting(version, mjcf) as new:
            if new:
                self.registry.decide("stored", version=version.id, name=alias)
            elif alias is not None and self.aliases().get(alias) != version.id:
                self.registry.decide("named", version=version.id, name=alias)
        return self.get(version.id)

    def set_alias(self, alias: str, reference: str) -> Version:
        """Let a name point at a version. `current` promotes; `previous` follows by itself."""
        if alias == CURRENT:
            return self.promote(reference)
        _must_be_free(alias)
        with self.writing():
            version = self._usable(reference)
            if self.aliases().get(alias) != version.id:
                self.registry.decide("named", version=version.id, name=alias)
        return version

    def remove_alias(self, alias: str) -> str:
        """Take a name of your own away; returns the id that it pointed at."""
        _must_be_free(alias)
        with self.writing():
            version_id = self.aliases().get(alias)
            if version_id is None:
                raise BadInput(f"no version of {self.hand} is called '{alias}'", todo="See 'twin versions list'")
            self.registry.decide("unnamed", version=version_id, name=alias)
        return version_id

    def propose(self, draft: Draft, mjcf: str) -> Proposed:
        """Store a version as the candidate; without a name where held-out motion says that it is not better."""
        better = draft.better_on_held_out is not False
        return Proposed(self.add(draft, mjcf, alias=CANDIDATE if better else None), better)

    def promote(self, reference: str = CANDIDATE, *, reason: str | None = None, force: bool = False) -> Version:
        """Make a version current; what was current becomes previous. A candidate is decided about by that.

        One that is worse than the version in use is refused (BadInput), unless it is forced, which needs a reason; the
        reason stands in the log of decisions. The nominal model is let through: it is where every way back ends.
        """
        if force and not (reason or "").strip():
            raise BadInput("a promotion is forced without a reason", todo="Say why with --reason TEXT")
        with self.writing():
            version = self._usable(reference)
            names = self.aliases()
            worse = self.worse_than_current(version)
            if worse is not None and version.id != NOMINAL and not force:
                raise BadInput(
                    f"{version.short_id} is worse than {names[CURRENT][:12]}, which is in use: {worse.words}",
                    todo="Nothing was changed. If it has to be: --force --reason TEXT",
                )
            if version.id != names.get(CURRENT) or version.id == names.get(CANDIDATE):
                said = (reason or "").strip() or None
                forced = f"promoted although worse ({worse.words}): {said}" if worse is not None and force else said
                self.registry.decide("promoted", version=version.id, text=forced)
        return version

    def worse_than_current(self, version: Version) -> Worse | None:
        """How much worse a version is than the one in use, on data that both know; None where that is not known."""
        versions = self.list()
        current = next((one for one in versions if one.id == self.aliases()[CURRENT]), None)
        return None if current is None else worse_than(version, current, known_errors(versions))

    def reject(self) -> Version:
        """Decide against the candidate. The version stays; only the name goes."""
        with self.writing():
            version = self.get(CANDIDATE)
            self.registry.decide("rejected", version=version.id)
        return version

    def rollback(self, expected: str | None = None, *, reason: str | None = None) -> Version:
        """Make the previous version current again; below the first promotion lies the nominal model, where it ends.

        Raises BadInput where the previous version is damaged. With `expected` (an id) nothing moves unless that version
        is current: whoever found it bad may be late. The reason stands in the log of decisions.
        """
        with self.writing():
            names = self.aliases()
            if expected is not None and names.get(CURRENT) != expected:
                raise BadInput(
                    f"{expected[:12]} is not current any more", where=f"versions of {self.hand}", todo="Nothing to do"
                )
            if PREVIOUS not in names:
                return self.get(NOMINAL)
            version = self._usable(names[PREVIOUS])
            self.registry.decide("rolled_back", version=version.id, text=(reason or "").strip() or None)
        return version

    def note(self, reference: str, text: str) -> Version:
        """Write a note beside a version, which itself never changes."""
        if not text.strip():
            raise BadInput("a note needs words")
        with self.writing():
            version = self.get(reference)
            self.registry.decide("noted", version=version.id, text=text.strip())
        return version

    # -- reading

    def get(self, reference: str) -> Version:
        """The version that an id, the start of one, an alias or a shipped name stands for, verified."""
        stored = self.resolve(reference)
        return nominal(self.hand) if stored.id == NOMINAL else self.contents.read(stored).version

    def model(self, reference: str) -> str:
        """The MJCF text of a version, verified. Raises BadInput for a stub."""
        stored = self.resolve(reference)
        if stored.id == NOMINAL:
            return self._nominal_model()
        contents = self.contents.read(stored)
        if contents.mjcf is None:
            raise BadInput(
                f"the model of {contents.version.short_id} was pruned; its numbers are still here",
                where=stored.folder,
                todo="Restore a backup that has it ('twin versions restore FILE --merge'), or use another version",
            )
        return contents.mjcf

    def current(self) -> Version:
        """The version in use: the nominal one while nothing else was promoted."""
        return self.get(CURRENT)

    def last_promoted(self) -> Version | None:
        """The version in use, where somebody decided that it is; None before the first promotion."""
        return self.current() if self.registry.aliases().promoted else None

    def list(self) -> list[Version]:
        """Every version that can be read, the nominal one first, then the oldest."""
        return self.survey()[0]

    def survey(self) -> tuple[list[Version], list[str]]:
        """Every version that can be read, oldest first, and one line for each that is damaged.

        Files that look unchanged since they were verified are not read again; `verify` reads all.
        """
        found = self.everything()
        return self.in_order(found), list(found.problems)

    def everything(self, *, trust: bool = True) -> Survey:
        """What `survey` says, with what is a stub. Without `trust` every file is read."""
        found = self.contents.survey(trust=trust)
        return replace(found, versions={NOMINAL: nominal(self.hand), **found.versions})

    def in_order(self, found: Survey) -> list[Version]:
        """Oldest first by when they were stored here; before them the nominal one, then shipped and unlogged ones by
        when they were made."""
        first = order(self.decisions().decisions)
        return sorted(found.versions.values(), key=lambda v: (*first.get(v.id, (0, 0)), v.created or "", v.id))

    def decisions(self) -> DecisionLog:
        """Everything that was done to the versions of this hand, in order."""
        return self.registry.decisions()

    def aliases(self) -> dict[str, str]:
        """Names that move and the ids that they point at."""
        return self.registry.aliases().as_dict()

    def names(self, version_id: str) -> list[str]:
        """Aliases and shipped names of a version."""
        return self.all_names().get(version_id, [])

    def all_names(self) -> dict[str, list[str]]:
        """Aliases and shipped names by the id that they stand for."""
        pairs = [(NOMINAL, NOMINAL), *((target, alias) for alias, target in self.aliases().items())]
        pairs += [(s.id, s.name) for s in self.contents.everything() if s.name]
        found: dict[str, list[str]] = {}
        for version_id, name in pairs:
            found.setdefault(version_id, []).append(name)
        return found

    def notes(self) -> dict[str, list[Note]]:
        """What was written beside versions, and why they were promoted, by id, oldest first."""
        found: dict[str, list[Note]] = {}
        for decision in self.decisions().decisions:
            if decision.what in ("noted", "promoted") and decision.version and decision.text:
                found.setdefault(decision.version, []).append(Note(decision.at, decision.text))
        return found

    def shipped(self, version_id: str) -> bool:
        """Whether nobody made a version here."""
        return version_id in self.all_shipped()

    def all_shipped(self) -> set[str]:
        """The versions that nobody made here: those that came with the package, and the nominal one."""
        return {NOMINAL, *(stored.id for stored in self.contents.everything() if stored.shipped)}

    def resolve(self, reference: str) -> Stored:
        """Where the version is that a reference stands for. Raises BadInput when there is none, or more than one."""
        aliases = self.aliases()
        if aliases.get(reference, reference) == NOMINAL:
            return Stored(NOMINAL, self.root, NOMINAL)
        if reference in (CURRENT, PREVIOUS, CANDIDATE) and reference not in aliases:
            todo = "The nominal model is in use, and nothing was before it"
            if reference == CANDIDATE:
                todo = "Every stored one was decided about. 'twin calibrate' makes one; 'twin versions list' shows all"
            raise BadInput(f"no version of {self.hand} is {reference} now", todo=todo)
        wanted = aliases.get(reference, reference)
        everything = self.contents.everything()
        found = {s.id: s for s in reversed(everything) if wanted in (s.id, s.name)}
        if not found and len(wanted) >= SHORTEST_PREFIX:
            found = {s.id: s for s in reversed(everything) if s.id.startswith(wanted)}
        if len(found) == 1:
            return next(iter(found.values()))
        if found:
            ids = ", ".join(sorted(version_id[: len(wanted) + 6] for version_id in found))
            raise BadInput(
                f"'{reference}' stands for several versions of {self.hand}", allowed=ids, todo="Give more of the id"
            )
        known = [NOMINAL, *aliases, *(s.name for s in everything if s.name), *(s.id[:12] for s in everything)]
        hint = nearest(reference, known)
        todo = f"{hint}{'' if hint.endswith('?') else '.'} See 'twin versions list'"
        raise BadInput(f"no version '{reference}' of {self.hand}", todo=todo)

    def export(self, reference: str, path: Path) -> Version:
        """Write the version as one plain MJCF that MuJoCo loads without this package."""
        import mujoco  # the only thing here that needs the engine

        stored = self.resolve(reference)
        mjcf = self.model(stored.id)
        try:
            mujoco.MjModel.from_xml_string(mjcf)
        except ValueError as error:
            raise BadInput(f"MuJoCo does not load this version: {error}", where=stored.folder) from None
        if not path.absolute().parent.is_dir():
            raise BadInput("the folder does not exist", where=path, todo=f"Create {path.parent} or name another path")
        write_atomically(path, mjcf.encode())
        return self.get(stored.id)

    # -- for those who write

    @contextmanager
    def writing(self, *, thorough: bool = False) -> Iterator[None]:
        """Alone among writers; what dead writers left behind is finished or gone."""
        with locked(self.root), machine_errors(self.root):
            unfinished = self.contents.sweep()
            self.registry.settle(self._own_by_age, thorough=thorough or unfinished)
            yield

    def _own_by_age(self) -> list[str]:
        own = {stored.id for stored in self.contents.own()}
        versions = (version for key, version in self.contents.survey().versions.items() if key in own)
        made = {version.id: version.created or "" for version in versions}
        return sorted(made, key=lambda version_id: (made[version_id], version_id))

    def _usable(self, reference: str) -> Version:
        """A version with its model, which is what a name may point at."""
        version = self.get(reference)
        if version.id != NOMINAL:  # whose model is the description's, which a daemon could not run without
            self.model(version.id)
        return version

    def _nominal_model(self) -> str:
        if self._described is None:
            raise BadInput(f"the nominal model of {self.hand} is in its description", todo="Name it with --hand")
        return self._described()


def _must_be_free(alias: str) -> None:
    if alias in (CURRENT, PREVIOUS, NOMINAL) or not NAME.fullmatch(alias) or ID.fullmatch(alias):
        raise BadInput(f"'{alias}' cannot be set", allowed="candidate, or a name of your own")
