"""The versions of one hand: immutable folders, a few names that move, and no state in between.

A version is written into a hidden folder beside the others, made durable, and renamed into place. A process that is
killed at any moment leaves the old set or the new one, and a hidden folder that the next writer removes. Readers need
no lock; writers hold one, which the kernel releases when they die.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.errors import BadInput, NoAnswer, nearest
from twin_daemon.files import leftovers, sync_folder, write_atomically
from twin_daemon.resources import models_dir, state_dir
from twin_daemon.versions.aliases import CURRENT, PREVIOUS, Aliases, read_aliases, write_aliases
from twin_daemon.versions.folder import read_folder, read_model, write_folder
from twin_daemon.versions.version import Draft, Version, seal

SHORTEST_PREFIX = 4
_HIDDEN = ".new-"
_LOCK_WAIT_S = 30.0
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_ID = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Stored:
    """Where a version is. `name` is set for those that come with the package."""

    id: str
    folder: Path
    name: str | None = None

    @property
    def shipped(self) -> bool:
        return self.name is not None


class VersionStore:
    """Versions of the hand called `hand`, stored under `root` (default: the state folder), plus the shipped ones."""

    def __init__(self, hand: str, root: Path | None = None, shipped: Path | None = None) -> None:
        if not _NAME.fullmatch(hand):
            raise BadInput(f"'{hand}' cannot name a folder of versions", allowed="letters, digits and _.-")
        self.hand = hand
        self.root = root if root is not None else state_dir() / "hands" / hand
        self._folders = self.root / "versions"
        self._aliases = self.root / "aliases.json"
        self._shipped = shipped if shipped is not None else models_dir() / hand / "versions"

    # -- writing

    def add(self, draft: Draft, mjcf: str, *, alias: str | None = None) -> Version:
        """Store a version and, if asked, let `alias` (usually `candidate`) point at it.

        The same content always gets the same id; adding it again stores nothing new.
        """
        version = seal(draft, mjcf)
        with self._writing():
            target = self._folders / version.id
            if not self._intact(target):
                self._put(version, mjcf, target)
            if alias is not None:
                self._point(alias, version.id)
        return self._read(Stored(version.id, target))

    def set_alias(self, alias: str, reference: str) -> Version:
        """Let a name point at a version. `current` promotes; `previous` follows by itself."""
        version = self.get(reference)
        with self._writing():
            self._point(alias, version.id)
        return version

    def promote(self, reference: str = "candidate") -> Version:
        """Make a version current; what was current becomes previous."""
        return self.set_alias(CURRENT, reference)

    def rollback(self) -> Version:
        """Make the previous version current again. Raises BadInput if there is none, or if it is damaged."""
        with self._writing():
            aliases = read_aliases(self._aliases)
            if len(aliases.promoted) < 2:
                raise BadInput(
                    "there is no previous version to go back to",
                    where=f"versions of {self.hand}",
                    todo="See 'twin versions list'",
                )
            version = self.get(aliases.promoted[-2])
            write_aliases(self._aliases, aliases.roll_back())
        return version

    # -- reading

    def get(self, reference: str) -> Version:
        """The version that an id, the start of one, an alias or a shipped name stands for, verified."""
        return self._read(self.resolve(reference))

    def model(self, reference: str) -> str:
        """The MJCF text of a version, verified."""
        stored = self.resolve(reference)
        return read_model(stored.folder, self._todo(stored))

    def current(self) -> Version | None:
        """The version in use; None while nothing was promoted (the nominal model is in use)."""
        current = self.aliases().get(CURRENT)
        return None if current is None else self.get(current)

    def list(self) -> list[Version]:
        """Every version that can be read, oldest first."""
        return self.survey()[0]

    def survey(self) -> tuple[list[Version], list[str]]:
        """Every version that can be read, oldest first, and one line for each that is damaged."""
        versions: dict[str, Version] = {}
        problems: list[str] = []
        for stored in self._stored():
            try:
                versions.setdefault(stored.id, self._read(stored))
            except BadInput as error:
                problems.append(error.line())
        return sorted(versions.values(), key=lambda version: (version.created, version.id)), problems

    def aliases(self) -> dict[str, str]:
        """Names that move and the ids that they point at."""
        return read_aliases(self._aliases).as_dict()

    def names(self, version_id: str) -> list[str]:
        """Aliases and shipped names of a version."""
        moving = [alias for alias, target in self.aliases().items() if target == version_id]
        return moving + [stored.name for stored in self._stored() if stored.id == version_id and stored.name]

    def shipped(self, version_id: str) -> bool:
        """Whether a version came with the package."""
        return any(stored.id == version_id and stored.shipped for stored in self._stored())

    def resolve(self, reference: str) -> Stored:
        """Where the version is that a reference stands for. Raises BadInput when there is none, or more than one."""
        aliases = self.aliases()
        if reference in (CURRENT, PREVIOUS) and reference not in aliases:
            raise BadInput(
                f"no version of {self.hand} is {reference} yet", todo="Promote one: 'twin versions promote ID'"
            )
        wanted = aliases.get(reference, reference)
        everything = self._stored()
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
        known = [*aliases, *(s.name for s in everything if s.name), *(s.id[:12] for s in everything)]
        hint = nearest(reference, known)
        todo = f"{hint}{'' if hint.endswith('?') else '.'} See 'twin versions list'"
        raise BadInput(f"no version '{reference}' of {self.hand}", todo=todo)

    def export(self, reference: str, path: Path) -> Version:
        """Write the version as one plain MJCF that MuJoCo loads without this package."""
        import mujoco  # the only thing here that needs the engine

        stored = self.resolve(reference)
        mjcf = read_model(stored.folder, self._todo(stored))
        try:
            mujoco.MjModel.from_xml_string(mjcf)
        except ValueError as error:
            raise BadInput(f"MuJoCo does not load this version: {error}", where=stored.folder) from None
        if not path.absolute().parent.is_dir():
            raise BadInput("the folder does not exist", where=path, todo=f"Create {path.parent} or name another path")
        write_atomically(path, mjcf.encode())
        return self._read(stored)

    # -- inside

    def _stored(self) -> list[Stored]:
        own = sorted(self._folders.iterdir()) if self._folders.is_dir() else []
        found = [Stored(folder.name, folder) for folder in own if _ID.fullmatch(folder.name)]
        for folder in sorted(self._shipped.iterdir()) if self._shipped.is_dir() else []:
            if folder.is_dir() and _NAME.fullmatch(folder.name):
                found.append(Stored(_claimed_id(folder), folder, name=folder.name))
        return found

    def _read(self, stored: Stored) -> Version:
        version = read_folder(stored.folder, self._todo(stored))
        if version.id != stored.id or version.hand != self.hand:
            raise BadInput("this version belongs elsewhere", where=stored.folder, todo=self._todo(stored))
        return version

    def _todo(self, stored: Stored) -> str:
        if stored.shipped:
            return "Install the package again"
        return f"Restore it from a backup or delete {stored.folder}; the other versions are not touched"

    def _intact(self, folder: Path) -> bool:
        try:
            read_folder(folder, "")
        except BadInput:
            return False
        return True

    def _put(self, version: Version, mjcf: str, target: Path) -> None:
        hidden = Path(tempfile.mkdtemp(prefix=_HIDDEN, dir=self._folders))
        try:
            write_folder(hidden / version.id, version, mjcf)
            if target.exists():  # damaged: the same content is at hand, so it is put right
                target.rename(hidden / "damaged")
            (hidden / version.id).rename(target)
            sync_folder(self._folders)
        finally:
            shutil.rmtree(hidden, ignore_errors=True)

    def _point(self, alias: str, version_id: str) -> None:
        if alias == PREVIOUS or not _NAME.fullmatch(alias) or _ID.fullmatch(alias):
            raise BadInput(f"'{alias}' cannot be set", allowed="current, candidate, or a name of your own")
        aliases: Aliases = read_aliases(self._aliases)
        changed = aliases.promote(version_id) if alias == CURRENT else aliases.name(alias, version_id)
        if changed != aliases:
            write_aliases(self._aliases, changed)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Alone among writers; what dead writers left behind is gone."""
        self._folders.mkdir(parents=True, exist_ok=True)
        handle = os.open(self.root / ".lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        try:
            _lock(handle, self.root)
            for leftover in self._folders.glob(f"{_HIDDEN}*"):
                shutil.rmtree(leftover, ignore_errors=True)
            for half in leftovers(self._aliases):
                half.unlink(missing_ok=True)
            yield
        finally:
            os.close(handle)


def _lock(handle: int, where: Path) -> None:
    deadline = time.monotonic() + _LOCK_WAIT_S
    while True:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if time.monotonic() > deadline:
                raise NoAnswer(
                    "another process has been writing versions for too long", where=where, todo="End it and try again"
                ) from None
            time.sleep(0.01)


def _claimed_id(folder: Path) -> str:
    """The id that a shipped folder says it has; verified only when it is read."""
    found = re.search(r'"id": "([0-9a-f]{64})"', _text(folder / "version.json"))
    return found.group(1) if found else f"unreadable-{folder.name}"


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
