"""Certificates on the way to the network: which files an identity shows, as Zenoh takes them.

Both sides show one (mutual TLS), so that nobody without a certificate of this installation's authority gets a session.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from twin_daemon.errors import BadInput
from twin_daemon.privileges import gave_up_root, owner_on_the_way
from twin_daemon.resources import state_dir
from twin_daemon.security.identity import keys_file

AUTHORITY, CERTIFICATE, KEY = "authority.pem", "certificate.pem", "key.pem"
DAEMON = "daemon"
_LOOKS = "viewer"


def security_dir() -> Path:
    """Folder with one folder for each identity."""
    return state_dir() / "security"


def authority_dir() -> Path:
    """Folder of the authority's certificate and key: TWIN_AUTHORITY, such as a stick that is put away again; of a
    service beside root's keys, where no unit can read it; else in the folder of the identities."""
    if given := os.environ.get("TWIN_AUTHORITY"):
        return Path(given)
    keys = keys_file(state_dir())
    roots = gave_up_root() and owner_on_the_way(keys) is None
    return (keys.parent if roots else security_dir()) / "authority"


def is_tls(endpoint: str) -> bool:
    """Whether both sides show a certificate at this endpoint."""
    return endpoint.startswith(("tls/", "quic/"))


def shown_by_client(name: str | None) -> dict[str, Any]:
    """Zenoh's keys for a client: the folder of TWIN_SECURITY, else that of an identity (TWIN_AS, else the viewer's)."""
    given = os.environ.get("TWIN_SECURITY")
    folder = Path(given) if given else security_dir() / (name or os.environ.get("TWIN_AS") or _LOOKS)
    files = _files(folder)
    return _link(files | {"connect_private_key": folder / KEY, "connect_certificate": folder / CERTIFICATE})


def shown_by_daemon() -> dict[str, Any]:
    """Zenoh's keys for the router, which takes nobody without a certificate, and for the daemon that connects to it."""
    folder = security_dir() / DAEMON
    files = _files(folder)
    own = {"private_key": folder / KEY, "certificate": folder / CERTIFICATE}
    return _link(files | {f"{side}_{name}": path for side in ("listen", "connect") for name, path in own.items()})


def _files(folder: Path) -> dict[str, Path]:
    missing = [name for name in (AUTHORITY, CERTIFICATE, KEY) if not (folder / name).is_file()]
    if missing:
        raise BadInput(
            f"no {missing[0]}",
            where=folder,
            todo="Run 'twin security init' beside the daemon; elsewhere set TWIN_SECURITY to a copy of one",
        )
    return {"root_ca_certificate": folder / AUTHORITY}


def _link(files: dict[str, Path]) -> dict[str, Any]:
    return {"transport/link/tls": {"enable_mtls": True, **{name: str(path) for name, path in files.items()}}}
