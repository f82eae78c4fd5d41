"""One version on disk: a folder of three files that plain tools can read and check.

version.json   the version, its numbers and where they came from
model.xml      the MJCF that it compiles to; plain MuJoCo loads it
SHA256SUMS     sums of both (`sha256sum -c SHA256SUMS`)
"""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

from pydantic import ValidationError

from twin_daemon.errors import BadInput
from twin_daemon.files import sync_folder
from twin_daemon.versions.version import Version

RECORD, MODEL, SUMS = "version.json", "model.xml", "SHA256SUMS"
READ_ONLY = 0o444


def write_folder(folder: Path, version: Version, mjcf: str) -> None:
    """Fill a new folder and make it durable. Only its later rename makes it a version."""
    folder.mkdir(parents=True)
    contents = {
        RECORD: (json.dumps(version.as_json(), indent=2, ensure_ascii=False, allow_nan=False) + "\n").encode(),
        MODEL: mjcf.encode(),
    }
    contents[SUMS] = "".join(f"{_sum(data)}  {name}\n" for name, data in contents.items()).encode()
    for name, data in contents.items():
        with (folder / name).open("xb") as file:
            file.write(data)
            file.flush()
            os.fchmod(file.fileno(), READ_ONLY)
            os.fsync(file.fileno())
    sync_folder(folder)


def read_folder(folder: Path, todo: str) -> Version:
    """The version in a folder, verified: sums, content id and model. Raises BadInput with the file at fault."""
    return _read(folder, todo)[0]


def read_model(folder: Path, todo: str) -> str:
    """The MJCF text of a verified version."""
    return _read(folder, todo)[1]


def _read(folder: Path, todo: str) -> tuple[Version, str]:
    sums = _bytes(folder / SUMS, todo)
    contents = {name: _bytes(folder / name, todo) for name in (RECORD, MODEL)}
    lines = (line.split(maxsplit=1) for line in sums.decode("ascii", "replace").splitlines())
    listed = {line[1]: line[0] for line in lines if len(line) == 2}
    for name, data in contents.items():
        if listed.get(name) != _sum(data):
            raise BadInput(
                "the file is not the one that was stored (its SHA-256 differs)", where=folder / name, todo=todo
            )
    try:
        version = Version.model_validate_json(contents[RECORD])
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise BadInput(f"{key or 'content'}: {first['msg']}", where=folder / RECORD, todo=todo) from None
    if version.content_id() != version.id:
        raise BadInput("the content is not what its id stands for", where=folder / RECORD, todo=todo)
    if version.mjcf_sha256 != _sum(contents[MODEL]):
        raise BadInput("the model is not the one of this version", where=folder / MODEL, todo=todo)
    return version, contents[MODEL].decode()


def _bytes(path: Path, todo: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", where=path, todo=todo) from None


def _sum(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
