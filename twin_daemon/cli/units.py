"""What a service of systemd is made of: its files, where they belong, and a receipt of what was written."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.resources import systemd_dir

GATE, DAEMON, BRIDGE, WORKBENCH = (
    "twin-gate.service",
    "twin-daemon.service",
    "twin-bridge-ros2.service",
    "twin-workbench.service",
)
TARGET = "twin.target"
UNITS = (GATE, DAEMON, BRIDGE, WORKBENCH, TARGET)
CONFIG = Path("etc/twin_daemon")
KEYS = CONFIG / "keys.json"
FOLDER = "identities"
"""Beside the keys of all: a folder for each unit with what it is given of them."""
RECEIPT = CONFIG / "installed.json"
STATE = Path("var/lib/twin_daemon")
_UNIT_FOLDER = Path("etc/systemd/system")
_SHIPPED_TWIN, _SHIPPED_FOLDER = "/opt/twin_daemon/.venv/bin/twin", "/opt/twin_daemon/systemd"
_UNREADABLE = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")


@dataclass(frozen=True)
class Planned:
    """One file below the root of a system. What is `personal` is written once and then belongs to whoever edits it."""

    place: Path
    content: bytes
    personal: bool = False


def planned(executable: Path) -> list[Planned]:
    """The files of the service that runs `executable`."""
    shipped = systemd_dir()
    files = [Planned(_UNIT_FOLDER / name, _unit(shipped / name, executable)) for name in UNITS]
    users = shipped / "twin-daemon.sysusers.conf"
    files.append(Planned(Path("etc/sysusers.d") / users.name, users.read_bytes()))
    files.append(Planned(CONFIG / "twin.yaml", (shipped / "twin.yaml").read_bytes(), personal=True))
    return files


def _unit(path: Path, executable: Path) -> bytes:
    text = path.read_text(encoding="utf-8").replace(_SHIPPED_TWIN, str(executable))
    return text.replace(_SHIPPED_FOLDER, str(systemd_dir())).encode()


def require_readable(*paths: Path) -> None:
    """BadInput for a program in a place that the units cannot read."""
    for path in paths:
        if any(path.is_relative_to(folder) for folder in _UNREADABLE):
            raise BadInput(
                "the service cannot read this folder, it is protected from homes and temporary files",
                where=path,
                todo="Install twin_daemon and its Python elsewhere, such as /opt/twin_daemon with the system's Python",
            )
        if any(mark in str(path) for mark in " %\\\"'$"):
            raise BadInput("a unit cannot name this path", where=path, allowed="no spaces, quotes, % or $")


def write(root: Path, files: list[Planned]) -> None:
    """Writes the files and the receipt. A unit that was edited by hand is kept beside, as *.saved."""
    known = receipt(root)
    for file in files:
        path = root / file.place
        if path.exists():
            if file.personal:
                continue
            _save_edited(path, known.get(str(file.place)))
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomically(path, file.content)
        known[str(file.place)] = _digest(file.content)
    content = json.dumps({"schema": 1, "files": known}, indent=1) + "\n"
    write_atomically(root / RECEIPT, content.encode())


def remove(root: Path) -> list[Path]:
    """Removes what the receipt names; returns what stays because somebody edited it."""
    kept = []
    for place, digest in receipt(root).items():
        path = root / place
        if not path.is_file():
            continue
        if path.is_relative_to(root / CONFIG) and _digest(path.read_bytes()) != digest:
            kept.append(path)
            continue
        if _save_edited(path, digest):
            kept.append(_saved(path))
        path.unlink(missing_ok=True)
    (root / RECEIPT).unlink(missing_ok=True)
    folder = root / CONFIG
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()
    return kept


def receipt(root: Path) -> dict[str, str]:
    """SHA-256 of each file that was written, by its place below the root; nothing where nothing is installed."""
    path = root / RECEIPT
    if not path.exists():
        return {}
    try:
        files = json.loads(path.read_text(encoding="utf-8"))["files"]
        return {str(place): str(digest) for place, digest in files.items() if Path(place).parts[0] == "etc"}
    except (ValueError, KeyError, TypeError, AttributeError, IndexError):
        raise BadInput("not a receipt of 'twin service install'", where=path, todo="Remove it and install again") from (
            None
        )


def _save_edited(path: Path, digest: str | None) -> bool:
    if digest is None or _digest(path.read_bytes()) == digest:
        return False
    path.replace(_saved(path))
    return True


def _saved(path: Path) -> Path:
    return path.with_name(f"{path.name}.saved")


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
