"""The store in one file: a plain tar that `tar` and `sha256sum -c MANIFEST` read without this package.

MANIFEST                              sums of all other files
hands/<hand>/log.jsonl, aliases.json  what was decided, where the names point
hands/<hand>/versions/<id>/...        the versions
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import tarfile
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.errors import BadInput
from twin_daemon.files import make_folder, sync_folder
from twin_daemon.resources import state_dir
from twin_daemon.versions.content_store import ID, NAME
from twin_daemon.versions.locking import locked, machine_errors
from twin_daemon.versions.registry import LOG_FILE, NAMES_FILE
from twin_daemon.versions.store import HANDS, VersionStore
from twin_daemon.versions.verify import verify

MANIFEST = "MANIFEST"
_MEMBER = re.compile(
    rf"{HANDS}/(?P<hand>{NAME.pattern})/"
    rf"(log\.jsonl|aliases\.json|versions/{ID.pattern}/(version\.json|model\.xml|SHA256SUMS))"
)
_STAGING = ".restore-"


@dataclass(frozen=True)
class Backup:
    """What went into a file, by hand: ids; and one line for everything damaged, which was left out."""

    hands: dict[str, tuple[str, ...]]
    bytes: int
    problems: tuple[str, ...]


@dataclass(frozen=True)
class Restored:
    """What came out of a file for one hand: "restored" whole, "merged", or "unchanged" where all of it was here."""

    hand: str
    how: str
    versions: tuple[str, ...]


def hands_with_versions(state: Path | None = None) -> list[str]:
    """Every hand that has a store in the state folder."""
    hands = (state or state_dir()) / HANDS
    found = sorted(hands.iterdir()) if hands.is_dir() else []
    return [path.name for path in found if NAME.fullmatch(path.name) and (path / "versions").is_dir()]


def back_up(stores: Sequence[VersionStore], path: Path, *, replace: bool = False) -> Backup:
    """Write the stores into one tar. Damaged versions are left out and told. Raises BadInput."""
    if path.exists() and not replace:
        raise BadInput("this file exists", where=path, todo="Name another one, or replace it with --replace")
    if not path.absolute().parent.is_dir():
        raise BadInput("the folder does not exist", where=path, todo=f"Create {path.parent} or name another path")
    contents: dict[str, Path] = {}
    hands: dict[str, tuple[str, ...]] = {}
    problems: list[str] = []
    for store in stores:
        found = verify(store)
        problems += found.problems
        own = {stored.id: stored.folder for stored in store.contents.own()}
        hands[store.hand] = tuple(version for version in found.intact if version in own)
        files = [store.registry.log_path, store.registry.names_path]
        files += [file for version in hands[store.hand] for file in sorted(own[version].iterdir())]
        contents |= {f"{HANDS}/{store.hand}/{file.relative_to(store.root)}": file for file in files if file.is_file()}
    if not any(hands.values()):
        raise BadInput("there are no versions to back up", todo="See 'twin versions list'")
    _write_tar(path, {name: file for name, file in contents.items() if _MEMBER.fullmatch(name)})
    return Backup(hands, path.stat().st_size, tuple(problems))


def restore(path: Path, hand: str | None = None, *, merge: bool = False, state: Path | None = None) -> list[Restored]:
    """Bring back what a backup holds, of one hand or all; everything in it is checked before anything is changed.

    A hand that has versions already is refused where the backup differs from them, unless `merge` asks to add what is
    missing; names and what is here stay then. Raises BadInput.
    """
    state = state or state_dir()
    with locked(state / HANDS), machine_errors(state), _unpacked(path, state) as staging:
        hands = hands_with_versions(staging)
        if hand is not None and hand not in hands:
            raise BadInput(f"no versions of '{hand}' are in this backup", where=path, allowed=", ".join(hands))
        chosen = [hand] if hand is not None else hands
        sources = {name: VersionStore(name, root=staging / HANDS / name) for name in chosen}
        targets = {name: VersionStore(name, root=state / HANDS / name) for name in chosen}
        for name, source in sources.items():
            damaged = verify(source).problems
            if damaged:
                raise BadInput(f"{name}: {damaged[0]}", where=path, todo="Use another backup; nothing was changed")
            if not merge and _holds(targets[name]) and _differs(source, targets[name]):
                raise BadInput(
                    f"{name} has versions already, and this backup differs from them",
                    where=targets[name].root,
                    todo="Add what is missing and keep the names with --merge, or move that folder away first",
                )
        return [_bring_back(sources[name], targets[name]) for name in chosen]


def _bring_back(source: VersionStore, target: VersionStore) -> Restored:
    if not _holds(target):
        source.index.drop()
        versions = tuple(stored.id for stored in source.contents.own())
        with target.writing():  # the log first: what it names and is not there yet can be brought back again
            for file in (source.registry.log_path, source.registry.names_path):
                if file.is_file():
                    file.rename(target.root / file.name)
            sync_folder(target.root)
            shutil.rmtree(target.contents.folders, ignore_errors=True)
            source.contents.folders.rename(target.contents.folders)
            sync_folder(target.root)
        return Restored(target.hand, "restored", versions)
    missing = _missing(source, target)
    said = {(version, note.text) for version, notes in target.notes().items() for note in notes}
    with target.writing():
        for version in source.in_order(source.everything()):
            if version.id in missing:
                _take(source, target, version.id)
        for decision in source.decisions().decisions:
            text = f"{decision.text} ({decision.at[:16]})"
            known = {(decision.version, decision.text), (decision.version, text)} & said
            if decision.what == "noted" and decision.version in missing and not known:
                target.registry.decide("noted", version=decision.version, text=text)
    return Restored(target.hand, "merged" if missing else "unchanged", tuple(sorted(missing)))


def _take(source: VersionStore, target: VersionStore, version_id: str) -> None:
    """One version from a checked backup, under the target's lock."""
    contents = source.contents.read(source.resolve(version_id))
    if contents.mjcf is not None:
        with target.contents.putting(contents.version, contents.mjcf) as new:
            if new:
                target.registry.decide("stored", version=version_id)
        return
    source.resolve(version_id).folder.rename(target.contents.folders / version_id)
    sync_folder(target.contents.folders)
    target.registry.decide("stored", version=version_id)


def _missing(source: VersionStore, target: VersionStore) -> set[str]:
    """Versions that the target lacks, has damaged, or has as a stub where the source has the model."""
    there, wanted = target.everything(trust=False), source.everything()
    own = {stored.id for stored in source.contents.own()}
    return {
        version
        for version in wanted.versions.keys() & own
        if version not in there.versions or (version in there.stubs and version not in wanted.stubs)
    }


def _differs(source: VersionStore, target: VersionStore) -> bool:
    """Whether bringing back would mix two stores; not so where a restore of the same backup was cut off."""
    same = _logs(source, target) and source.registry.log_path.read_bytes() == target.registry.log_path.read_bytes()
    return bool(_missing(source, target)) and not same


def _logs(*stores: VersionStore) -> bool:
    return all(store.registry.log_path.is_file() for store in stores)


def _holds(store: VersionStore) -> bool:
    return bool(store.contents.own()) or store.registry.log_path.exists() or store.registry.names_path.exists()


def _write_tar(path: Path, contents: dict[str, Path]) -> None:
    """Whole or not at all; the sums are of the bytes that were written."""
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".tmp", dir=path.absolute().parent)
    try:
        with os.fdopen(handle, "wb") as file:
            with tarfile.open(fileobj=file, mode="w", format=tarfile.PAX_FORMAT) as tar:
                sums = ""
                for name, source in sorted(contents.items()):
                    data = source.read_bytes()
                    sums += f"{hashlib.sha256(data).hexdigest()}  {name}\n"
                    _add(tar, name, data, source.stat().st_mtime)
                _add(tar, MANIFEST, sums.encode(), 0.0)
            file.flush()
            os.fsync(file.fileno())
        Path(temporary).replace(path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    sync_folder(path.absolute().parent)


def _add(tar: tarfile.TarFile, name: str, data: bytes, modified_s: float) -> None:
    info = tarfile.TarInfo(name)
    info.size, info.mode, info.mtime = len(data), 0o644, int(modified_s)
    tar.addfile(info, io.BytesIO(data))


@contextmanager
def _unpacked(path: Path, state: Path) -> Iterator[Path]:
    """The files of a backup beside the stores, durable and with the sums that its manifest says."""
    for left in (state / HANDS).glob(f"{_STAGING}*"):  # of a restore that died
        shutil.rmtree(left, ignore_errors=True)
    staging = Path(tempfile.mkdtemp(prefix=_STAGING, dir=state / HANDS))
    try:
        sums = _extract(path, staging)
        manifest = staging / MANIFEST
        listed = manifest.read_text(encoding="ascii") if manifest.is_file() else ""
        said = {name: digest for digest, _, name in (line.partition("  ") for line in listed.splitlines())}
        if not said or said != sums:
            wrong = sorted({*said.items()} ^ {*sums.items()})
            what = f"{wrong[0][0]} is not what was backed up" if wrong else "this is no backup of versions"
            raise BadInput(what, where=path, todo="Use another backup; nothing was changed")
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)


def _extract(path: Path, staging: Path) -> dict[str, str]:
    """Sums of what was extracted. Anything that does not belong into a backup is refused."""
    sums: dict[str, str] = {}
    try:
        with tarfile.open(path, mode="r:") as tar:
            for info in tar:
                belongs = info.isreg() and not info.issparse()  # a sparse file is as large as it says it is
                if not belongs or not (info.name == MANIFEST or _MEMBER.fullmatch(info.name)):
                    raise BadInput(f"'{info.name:.200}' does not belong into a backup of versions", where=path)
                file = tar.extractfile(info)
                data = file.read() if file is not None else b""
                if len(data) != info.size:
                    raise BadInput("the file ends too early", where=path, todo="Use another backup")
                target = staging / info.name
                make_folder(target.parent)
                with target.open("xb") as out:
                    out.write(data)
                    out.flush()
                    os.fsync(out.fileno())
                    os.fchmod(out.fileno(), 0o644 if target.name in (LOG_FILE, NAMES_FILE) else 0o444)
                sync_folder(target.parent)
                if info.name != MANIFEST:
                    sums[info.name] = hashlib.sha256(data).hexdigest()
    except (tarfile.TarError, FileNotFoundError, IsADirectoryError, FileExistsError, EOFError, ValueError) as error:
        raise BadInput(
            f"cannot be read as a backup ({error!s:.200})", where=path, todo="Give a file of 'twin versions backup'"
        ) from None
    return sums
