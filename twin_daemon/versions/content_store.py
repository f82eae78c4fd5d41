"""The folders of one hand's versions: those that were made here, and those that come with the package."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.errors import BadInput, TwinError
from twin_daemon.files import make_folder, sync_folder
from twin_daemon.versions.folder import Contents, fingerprint, mend_folder, parse_record, read_folder, write_folder
from twin_daemon.versions.index import Index, Row
from twin_daemon.versions.version import Version

HIDDEN = ".new-"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
ID = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class Stored:
    """Where a version is. `name` is set for those that come with the package."""

    id: str
    folder: Path
    name: str | None = None

    @property
    def shipped(self) -> bool:
        return self.name is not None


@dataclass(frozen=True)
class Survey:
    """Every version that can be read, which of them are stubs, and one line for each that is damaged."""

    versions: dict[str, Version]
    stubs: frozenset[str]
    problems: tuple[str, ...]


class ContentStore:
    """The versions of `hand` under `folders` (its own) and `shipped` (read only, each in a folder with a name)."""

    def __init__(self, hand: str, folders: Path, shipped: Path, index: Index) -> None:
        self._hand = hand
        self.folders = folders
        self._shipped = shipped
        self.index = index

    # -- reading

    def own(self) -> list[Stored]:
        """What was stored here, without reading it."""
        found = sorted(self.folders.iterdir()) if self.folders.is_dir() else []
        return [Stored(folder.name, folder) for folder in found if ID.fullmatch(folder.name)]

    def everything(self) -> list[Stored]:
        """What was stored here and what comes with the package."""
        found = self.own()
        for folder in sorted(self._shipped.iterdir()) if self._shipped.is_dir() else []:
            if folder.is_dir() and NAME.fullmatch(folder.name):
                found.append(Stored(_claimed_id(folder), folder, name=folder.name))
        return found

    def read(self, stored: Stored) -> Contents:
        """A version, verified. Raises BadInput.

        A second look tells damage from a version that another process was pruning or mending at that moment.
        """
        try:
            return self._read(stored)
        except BadInput:
            return self._read(stored)

    def survey(self, *, trust: bool = True) -> Survey:
        """Everything there is. With `trust`, a folder that has not changed since it was verified is not read again."""
        cached = self.index.rows() if trust else {}
        versions: dict[str, Version] = {}
        stubs: set[str] = set()
        problems: list[str] = []
        fresh: dict[str, Row] = {}
        known: set[str] = set()
        for stored in self.everything():
            try:
                mark = fingerprint(stored.folder)
                row = cached.get(stored.id)
                if row is None or row.mark != mark or stored.shipped:
                    contents = self.read(stored)
                    row = Row(mark, contents.mjcf is not None, contents.record)
                    if not stored.shipped:
                        fresh[stored.id] = row
                    version = contents.version
                else:
                    version = parse_record(row.record)
            except BadInput as error:
                if stored.folder.exists():  # else it was pruned since it was listed
                    problems.append(error.line())
                continue
            if not stored.shipped:
                known.add(stored.id)
            if stored.id in versions and not (stored.id in stubs and row.whole):
                continue
            versions[stored.id] = version
            stubs = stubs - {stored.id} if row.whole else stubs | {stored.id}
        if fresh or cached.keys() - known:
            self.index.write(fresh, known=known)
        return Survey(versions, frozenset(stubs), tuple(problems))

    # -- writing, by whoever holds the lock

    @contextmanager
    def putting(self, version: Version, mjcf: str) -> Iterator[bool]:
        """Store a version; yields whether anything was written. It is taken back where the body fails."""
        target = self.folders / version.id
        if self._whole(target):
            yield False
            return
        with self.scratch() as hidden:
            if target.exists():
                mend_folder(target, version, mjcf, hidden)
                yield True
                return
            write_folder(hidden / version.id, version, mjcf)
            (hidden / version.id).rename(target)
            sync_folder(self.folders)
            try:
                yield True
            except OSError:
                target.rename(hidden / version.id)
                raise

    def remove(self, version_ids: Sequence[str]) -> None:
        """Take versions away, each at once."""
        for version_id in version_ids:
            hidden = self.folders / f"{HIDDEN}{version_id}"
            (self.folders / version_id).rename(hidden)
            shutil.rmtree(hidden, ignore_errors=True)
        sync_folder(self.folders)

    @contextmanager
    def scratch(self) -> Iterator[Path]:
        """A hidden folder beside the versions.

        One that is found later says that its writer died or was interrupted; the next one then looks at everything.
        """
        make_folder(self.folders)
        hidden = Path(tempfile.mkdtemp(prefix=HIDDEN, dir=self.folders))
        try:
            yield hidden
        except (OSError, TwinError):
            shutil.rmtree(hidden, ignore_errors=True)
            raise
        shutil.rmtree(hidden, ignore_errors=True)

    def sweep(self) -> bool:
        """Remove what dead writers left behind; whether there was anything."""
        left = list(self.folders.glob(f"{HIDDEN}*"))
        for folder in left:
            shutil.rmtree(folder, ignore_errors=True)
        return bool(left)

    # -- inside

    def _read(self, stored: Stored) -> Contents:
        contents = read_folder(stored.folder, self._todo(stored))
        if contents.version.id != stored.id or contents.version.hand != self._hand:
            raise BadInput("this version belongs elsewhere", where=stored.folder, todo=self._todo(stored))
        return contents

    def _todo(self, stored: Stored) -> str:
        if stored.shipped:
            return "Install the package again"
        return f"Restore it from a backup or delete {stored.folder}; the other versions are not touched"

    def _whole(self, folder: Path) -> bool:
        try:
            return read_folder(folder, "").mjcf is not None
        except BadInput:
            return False


def _claimed_id(folder: Path) -> str:
    """The id that a shipped folder says it has; verified only when it is read."""
    found = re.search(r'"id": "([0-9a-f]{64})"', _text(folder / "version.json"))
    return found.group(1) if found else f"unreadable-{folder.name}"


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
