"""The lease between one 'twin command' and the next: each is a process of its own, and the lease is theirs together.

It stands in a file that only its owner reads. Another user, another machine and another state folder do not have it.
"""

from __future__ import annotations

import contextlib
import json
from pathlib import Path

from twin_daemon.cli.run import hand_folder
from twin_daemon.files import write_atomically

_MOST_BYTES = 1000


def lease_file(namespace: str, name: str) -> Path:
    """Where the lease of an identity stands, for one hand."""
    return hand_folder(namespace) / f"lease-{name}.json"


def kept_lease(path: Path) -> str:
    """The lease that was kept last, "" where there is none. Whether it still holds, only the gate knows."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError), path.open("rb") as file:
        return str(json.loads(file.read(_MOST_BYTES))["lease"])
    return ""


def keep_lease(path: Path, lease: str) -> None:
    """Keeps a lease for the commands that follow. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_atomically(path, json.dumps({"schema": 1, "lease": lease}).encode(), mode=0o600)
