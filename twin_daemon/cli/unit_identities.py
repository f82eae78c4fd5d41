"""What each unit of the service is given to prove itself with: an identity of its own, and nothing of the others'.

The folders are root's, so that no unit can put a link into them; the files are for one unit's user alone.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path

from twin_daemon.cli.units import FOLDER
from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.privileges import owner_on_the_way, read_regular
from twin_daemon.security.identity import KEYS, Keyring, Role, new_identity
from twin_daemon.security.tls import AUTHORITY, CERTIFICATE, KEY


@dataclass(frozen=True)
class UnitIdentity:
    """A unit that is no daemon: its user, and the identity that it has on the network and at the gate."""

    user: str
    role: Role


UNIT_IDENTITIES = {
    "workbench": UnitIdentity("twin-workbench", "viewer"),
    "bridge": UnitIdentity("twin-bridge", "hand"),
}


def with_unit_identities(keyring: Keyring) -> Keyring:
    """The keyring with an identity for each unit that has none yet."""
    for name, unit in UNIT_IDENTITIES.items():
        if name not in keyring:
            keyring = keyring.changed(name, new_identity(unit.role))
    return keyring


def certificates(folder: Path) -> dict[str, dict[str, bytes]]:
    """Certificate, key and authority of each unit's identity, by the names of their files, where there are any.

    They are in the folder of the daemon's user: read without following a link, and as he.
    """
    owner = owner_on_the_way(folder)
    owners = (0,) if owner is None else owner[:1]  # root would read his own secrets through a folder that is a link
    found = {}
    for name in UNIT_IDENTITIES:
        files = {file: read_regular(folder / name / file, owners) for file in (AUTHORITY, CERTIFICATE, KEY)}
        if all(content is not None for content in files.values()):
            found[name] = {file: content for file, content in files.items() if content is not None}
    return found


def hand_out(keys: Path, keyring: Keyring, passwd: Path, certified: dict[str, dict[str, bytes]]) -> None:
    """Writes the folder of each unit beside the file of all `keys`. `passwd` has the users of that system.

    What a unit had and has no more is taken away. For root, or for the tree of another system.
    """
    users = _users(passwd)
    for name, unit in UNIT_IDENTITIES.items():
        folder = keys.parent / FOLDER / name
        shutil.rmtree(folder, ignore_errors=True)
        if name not in keyring:
            continue
        if unit.user not in users:
            raise BadInput(f"no user '{unit.user}'", where=passwd, todo="Run 'twin service install' again")
        uid, gid = users[unit.user]
        folder.mkdir(parents=True, mode=0o750)
        keyring.only(name).save(folder / KEYS)
        for file, content in certified.get(name, {}).items():
            write_atomically(folder / file, content, mode=0o600)
        if os.geteuid() == 0:
            for file in folder.iterdir():
                os.chown(file, uid, gid, follow_symlinks=False)
            os.chown(folder, 0, gid, follow_symlinks=False)


def take_back(keys: Path) -> None:
    """Removes what the units were given."""
    shutil.rmtree(keys.parent / FOLDER, ignore_errors=True)


def _users(passwd: Path) -> dict[str, tuple[int, int]]:
    """User and group number of each user of a system."""
    lines = passwd.read_text(encoding="utf-8", errors="replace").splitlines() if passwd.is_file() else []
    fields = [line.split(":") for line in lines]
    return {one[0]: (int(one[2]), int(one[3])) for one in fields if len(one) > 3 and one[2].isdigit()}
