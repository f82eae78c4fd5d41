"""The recordings that the page offers: those of its folders, and those named at the start. No other file is opened.

A link that was named leads where it led at the start; one that lies in a folder leads nowhere.
"""

from __future__ import annotations

import hashlib
import stat
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.errors import BadInput

SUFFIXES = (".mcap", ".bag", ".db3", ".csv", ".csv.gz")
"""How the names of single files end that are taken for recordings."""

_SIGNS_OF_A_FOLDER = ("metadata.yaml", "control.csv")
_MOST_LISTED = 500


@dataclass(frozen=True)
class Offer:
    """One recording. `id` is all that a page can ask with."""

    id: str
    name: str
    folder: str
    bytes: int
    modified_s: float


class Library:
    """Looks anew at every question: recordings come and go while the page is open."""

    def __init__(self, files: Sequence[Path], folders: Sequence[Path]) -> None:
        self._files = [path.resolve() for path in files]
        self._folders = [folder.resolve() for folder in folders]

    def offers(self) -> list[Offer]:
        """Those named at the start first, then the folders' by age, the newest first."""
        named = [offer for path in self._files if (offer := _offer(path)) is not None]
        known = {offer.id for offer in named}
        found = (offer for path in self._in_folders() if (offer := _offer(path)) is not None)
        others = sorted((offer for offer in found if offer.id not in known), key=lambda offer: -offer.modified_s)
        return (named + others)[:_MOST_LISTED]

    def path(self, offer_id: str) -> Path:
        """The recording that an offer stands for. Raises BadInput where it is not offered any more."""
        for path in (*self._files, *self._in_folders()):
            if _id(path) == offer_id and _kind(path) in (stat.S_IFREG, stat.S_IFDIR):
                return path
        raise BadInput("this recording is not there any more", todo="Choose another one of the list")

    @property
    def folders(self) -> list[Path]:
        """Where it looks."""
        return list(self._folders)

    @staticmethod
    def offer_id(path: Path) -> str:
        """What a page asks with for a file of the folders."""
        return _id(path)

    def _in_folders(self) -> Iterator[Path]:
        for folder in self._folders:
            try:
                inside = sorted(folder.iterdir())
            except OSError:  # it comes with the first recording
                continue
            yield from (path for path in inside if _looks_like_one(path))


def _looks_like_one(path: Path) -> bool:
    kind = _kind(path)
    if kind == stat.S_IFDIR:
        return any(_kind(path / sign) == stat.S_IFREG for sign in _SIGNS_OF_A_FOLDER)
    return kind == stat.S_IFREG and path.name.endswith(SUFFIXES)


def _kind(path: Path) -> int:
    """What a name itself stands for, as in `stat.S_IFMT`; 0 where there is nothing."""
    try:
        return stat.S_IFMT(path.lstat().st_mode)
    except OSError:
        return 0


def _id(path: Path) -> str:
    return hashlib.sha256(str(path).encode(errors="surrogateescape")).hexdigest()[:16]


def _offer(path: Path) -> Offer | None:
    try:
        told = path.lstat()
        size = sum(file.lstat().st_size for file in path.iterdir()) if path.is_dir() else told.st_size
    except OSError:
        return None
    return Offer(_id(path), _shown(path.name), _shown(str(path.parent)), size, told.st_mtime)


def _shown(name: str) -> str:
    """A name of the file system, which may be no text at all, as text."""
    return name.encode(errors="replace").decode()
