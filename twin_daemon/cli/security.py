"""`twin security`: identities, the authority of this installation, and the certificates that it gives them."""

from __future__ import annotations

import shutil
import socket
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Json
from twin_daemon.cli.unit_identities import certificates, hand_out
from twin_daemon.cli.units import FOLDER
from twin_daemon.errors import BadInput, nearest
from twin_daemon.privileges import as_root, gave_up_root
from twin_daemon.resources import state_dir
from twin_daemon.security.certificate_authority import Authority, certificate_of
from twin_daemon.security.identity import KEYS, Keyring, Role, ensure_keyring, keys_file, load_keyring, new_identity
from twin_daemon.security.tls import DAEMON, authority_dir, security_dir

app = Group("Who may join the hand's network: identities and their certificates. docs/security.md has the whole story.")

Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the identity.")]
_RESERVED = ("authority", DAEMON)
_LOOPBACK = ("localhost", "127.0.0.1", "::1")


@app.command("init")
def init(
    host: Annotated[
        list[str] | None,
        typer.Option("--host", metavar="HOST", help="Name or address at which others reach the daemon."),
    ] = None,
    renew: Annotated[bool, typer.Option("--renew", help="New certificates for all, from the same authority.")] = False,
    json: Json = None,
) -> None:
    """Make an authority, identities and a certificate for each. Safe to repeat: what is good stays as it is."""
    keyring = ensure_keyring(keys_file(state_dir()))
    exposed = _in_the_units_reach()
    authority = Authority(security_dir(), authority_dir())
    authority.issue(DAEMON, [*_LOOPBACK, socket.gethostname(), *(host or [])], renew=renew)
    for name in keyring.names:
        _issue(authority, keyring, name, renew=renew)
    if exposed is not None:
        shutil.rmtree(exposed)
    _tell_the_units(keyring)
    found = _known(keyring)
    emit_json(json, found)
    _show(found, json)
    console = people(json)
    if exposed is not None:
        console.print(plain_text(f"The authority's key lay in {exposed}, where the daemon could read it."))
        console.print(
            plain_text(f"There is a new one in {authority_dir()}, and all certificates are new: copy them again")
        )
    console.print("In the daemon's configuration, and restart it:")
    console.print("  endpoint: tls/127.0.0.1:7447   # or the address at which others reach it", highlight=False)
    console.print("  access: {certificates: true}", highlight=False)
    console.print("On another machine: one identity's folder, named by TWIN_SECURITY, and TWIN_ENDPOINT=tls/HOST:7447")


@app.command("add")
def add(
    name: Name,
    role: Annotated[Role, typer.Option("--role", help="What it may do.")] = "viewer",
    json: Json = None,
) -> None:
    """Make an identity with a certificate. The daemon knows it from its next start."""
    path, keyring = _keyring()
    if name in keyring or name in _RESERVED:
        raise BadInput(f"'{name}' is there already", todo="Choose another name, or remove it first")
    keyring = keyring.changed(name, new_identity(role))
    keyring.save(path)
    _issue(Authority(security_dir(), authority_dir()), keyring, name)
    _tell_the_units(keyring)
    emit_json(json, _known(keyring))
    people(json).print(plain_text(f"{name} ({role}) is in {security_dir() / name}; restart the daemon to let it in"))


@app.command("remove")
def remove(name: Name, json: Json = None) -> None:
    """Take an identity away: from the daemon's next start its certificate opens nothing."""
    path, keyring = _keyring()
    if name not in keyring:
        raise BadInput(f"no identity '{name}'", todo=nearest(name, keyring.names))
    keyring = keyring.changed(name, None)
    keyring.save(path)
    shutil.rmtree(security_dir() / name, ignore_errors=True)
    _tell_the_units(keyring)
    emit_json(json, _known(keyring))
    people(json).print(plain_text(f"{name} is removed; restart the daemon to shut it out"))


@app.command("show")
def show(json: Json = None) -> None:
    """Which identities there are, what they may do, and until when their certificates last."""
    _, keyring = _keyring()
    found = _known(keyring)
    emit_json(json, found)
    _show(found, json)


def _keyring() -> tuple[Path, Keyring]:
    path = keys_file(state_dir())
    if not path.exists() or not security_dir().is_dir():
        raise BadInput("no authority yet", where=security_dir(), todo="Begin with 'twin security init'")
    return path, load_keyring(path)


def _issue(authority: Authority, keyring: Keyring, name: str, *, renew: bool = False) -> None:
    """A certificate, and the identity's own key beside it: all that this identity needs on another machine."""
    authority.issue(name, renew=renew)
    keyring.only(name).save(authority.folder / name / KEYS)


def _in_the_units_reach() -> Path | None:
    """Where an authority of before lies in the folder of the service's user, while root has a place of his own now."""
    before = security_dir() / "authority"
    return before if gave_up_root() and authority_dir() != before and before.is_dir() else None


def _tell_the_units(keyring: Keyring) -> None:
    """Root gives the units of a service their certificates and keys anew."""
    keys = keys_file(state_dir())
    folder = keys.parent / FOLDER
    if gave_up_root() and folder.is_dir():
        certified = certificates(security_dir())
        with as_root(folder):
            hand_out(keys, keyring, Path("/etc/passwd"), certified)


def _known(keyring: Keyring) -> dict[str, Any]:
    folder = security_dir()
    rows = []
    for name, role in ((DAEMON, "daemon"), *((name, keyring.role(name)) for name in keyring.names)):
        certificate = certificate_of(folder / name)
        until = None if certificate is None else certificate.not_valid_after_utc
        rows.append(
            {
                "name": name,
                "role": role,
                "folder": str(folder / name),
                "until": None if until is None else until.isoformat(),
                "valid": until is not None and until > datetime.now(UTC),
            }
        )
    return {"folder": str(folder), "identities": rows}


def _show(found: dict[str, Any], json: str | None) -> None:
    from twin_daemon.tables import slim_table

    table = slim_table(f"identities in {found['folder']}", ("name", "role", "certificate until"))
    for row in found["identities"]:
        until = "none" if row["until"] is None else row["until"][:10] + ("" if row["valid"] else ", over")
        table.add_row(plain_text(row["name"]), row["role"], until)
    people(json).print(table)
