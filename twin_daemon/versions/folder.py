"""One version on disk: a folder of three files that plain tools can read and check.

version.json   the version, its numbers and where they came from
model.xml      the MJCF that it compiles to; plain MuJoCo loads it
SHA256SUMS     sums of both (`sha256sum -c SHA256SUMS`)

A stub has no model.xml and no sum of it: its numbers and its place in the lineage stay, its model was pruned.
"""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.files import sync_folder
from twin_daemon.versions.decisions import refuse_newer
from twin_daemon.versions.version import VERSION_SCHEMA, Version, content_id

RECORD, MODEL, SUMS = "version.json", "model.xml", "SHA256SUMS"
FILES = (RECORD, MODEL, SUMS)
READ_ONLY = 0o444


@dataclass(frozen=True)
class Contents:
    """A verified version. `mjcf` is None for a stub."""

    version: Version
    record: bytes
    mjcf: str | None


def write_folder(folder: Path, version: Version, mjcf: str) -> None:
    """Fill a new folder and make it durable. Only its later rename makes it a version."""
    folder.mkdir(parents=True)
    for name, data in _files(version, mjcf).items():
        _write(folder / name, data)
    sync_folder(folder)


def mend_folder(folder: Path, version: Version, mjcf: str, scratch: Path) -> None:
    """Put right what is in a damaged folder, or give a stub its model back; whole files move in from `scratch`."""
    with suppress(BadInput):
        version = read_folder(folder, "").version  # a stub keeps its record as it was made
    for name, data in _files(version, mjcf).items():
        _move_in(scratch, folder / name, data)
    sync_folder(folder)


def strip_folder(folder: Path, scratch: Path) -> None:
    """Make a whole version a stub. At every moment it is one or the other."""
    record = (folder / RECORD).read_bytes()
    _move_in(scratch, folder / SUMS, _listing({RECORD: record}))
    sync_folder(folder)
    (folder / MODEL).unlink(missing_ok=True)
    sync_folder(folder)


def read_folder(folder: Path, todo: str) -> Contents:
    """The version in a folder, verified: sums, content id and model.

    Raises BadInput with the file at fault, and where a newer release wrote it.
    """
    sums = _bytes(folder / SUMS, todo)
    lines = (line.split(maxsplit=1) for line in sums.decode("ascii", "replace").splitlines())
    listed = {line[1]: line[0] for line in lines if len(line) == 2}
    names = [name for name in (RECORD, MODEL) if name in listed or name == RECORD or (folder / name).exists()]
    contents = {name: _bytes(folder / name, todo) for name in names}
    for name, data in contents.items():
        unlisted_model = name == MODEL and name not in listed  # on its way to or from a stub: the id vouches for it
        if listed.get(name) != _sum(data) and not unlisted_model:
            raise BadInput(
                "the file is not the one that was stored (its SHA-256 differs)", where=folder / name, todo=todo
            )
    version = _version(contents[RECORD], folder / RECORD, todo)
    mjcf = contents.get(MODEL)
    if mjcf is not None and version.mjcf_sha256 != _sum(mjcf):
        raise BadInput("the model is not the one of this version", where=folder / MODEL, todo=todo)
    return Contents(version, contents[RECORD], None if mjcf is None else mjcf.decode())


def parse_record(record: bytes) -> Version:
    """A record that was verified before."""
    return Version.model_validate_json(record)


def fingerprint(folder: Path) -> str:
    """What changes when a file of the folder is changed, replaced or removed; no file is read."""
    marks = []
    for name in FILES:
        try:
            stat = (folder / name).stat()
            marks.append(f"{stat.st_ino}.{stat.st_size}.{stat.st_mtime_ns}.{stat.st_ctime_ns}")
        except OSError:
            marks.append("-")
    return " ".join(marks)


def size_bytes(folder: Path, *names: str) -> int:
    """What the files of these names hold (all without names); 0 for one that another process has pruned."""
    total = 0
    for name in names or FILES:
        with suppress(FileNotFoundError):
            total += (folder / name).stat().st_size
    return total


def _version(record: bytes, path: Path, todo: str) -> Version:
    try:
        content = json.loads(record)
        refuse_newer(content.get("schema"), VERSION_SCHEMA, path)
        version = Version.model_validate(content)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise BadInput(f"{key or 'content'}: {first['msg']}", where=path, todo=todo) from None
    except (ValueError, AttributeError):
        raise BadInput("this is not a version", where=path, todo=todo) from None
    if content_id(content) != version.id:
        raise BadInput("the content is not what its id stands for", where=path, todo=todo)
    return version


def _files(version: Version, mjcf: str) -> dict[str, bytes]:
    contents = {
        RECORD: (json.dumps(version.as_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode(),
        MODEL: mjcf.encode(),
    }
    return {**contents, SUMS: _listing(contents)}


def _listing(contents: dict[str, bytes]) -> bytes:
    return "".join(f"{_sum(data)}  {name}\n" for name, data in contents.items()).encode()


def _write(path: Path, data: bytes) -> None:
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fchmod(file.fileno(), READ_ONLY)
        os.fsync(file.fileno())


def _move_in(scratch: Path, target: Path, data: bytes) -> None:
    _write(scratch / target.name, data)
    (scratch / target.name).replace(target)


def _bytes(path: Path, todo: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", where=path, todo=todo) from None


def _sum(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
