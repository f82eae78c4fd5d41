"""`twin security`: identities, the authority of this installation, and the certificates that it gives them."""

from __future__ import annotations

import os
import shutil
import socket
from datetime import UTC, datetime
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bridges.authority import Authority, certificate_of
from bridges.tls import DAEMON, security_dir
from twin_daemon.cli.command import Group
from twin_daemon.cli.console import emit_json, people, plain_text
from twin_daemon.cli.options import Json
from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.identity import KEYS, Keyring, Role, ensure_keyring, keys_file, load_keyring, new_identity
from twin_daemon.resources import state_dir

if TYPE_CHECKING:
    from pathlib import Path


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
    authority = Authority(security_dir())
    authority.issue(DAEMON, [*_LOOPBACK, socket.gethostname(), *(host or [])], renew=renew)
    for name in keyring.names:
        _issue(authority, keyring, name, renew=renew)
    _give_to_the_daemon()
    found = _known(keyring)
    emit_json(json, found)
    _show(found, json)
    console = people(json)
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
    _issue(Authority(security_dir()), keyring, name)
    _give_to_the_daemon()
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


def _give_to_the_daemon() -> None:
    """What root has made belongs to whom the state folder belongs to: the service's user, who has to read it."""
    owner = state_dir().stat()
    if os.geteuid() == 0 and owner.st_uid != 0:
        for path in (security_dir(), *security_dir().rglob("*")):
            os.chown(path, owner.st_uid, owner.st_gid)


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
    from twin_daemon.cli.tables import slim_table

    table = slim_table(f"identities in {found['folder']}", ("name", "role", "certificate until"))
    for row in found["identities"]:
        until = "none" if row["until"] is None else row["until"][:10] + ("" if row["valid"] else ", over")
        table.add_row(plain_text(row["name"]), row["role"], until)
    people(json).print(table)
