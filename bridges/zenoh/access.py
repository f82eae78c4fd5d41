"""Who may do what on the network: access control of the daemon's own router, denying by default.

The users are the identities of the key file. A user's password is derived from its key, so that one secret serves
here and at the gate, which proves every request once more: what slips through here still commands nothing.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from bridges.zenoh.ros_keys import RosKeys
from bridges.zenoh.streams import daemon_subscribes, heard_keys
from twin_daemon.daemon.settings import AccessSettings
from twin_daemon.errors import BadInput
from twin_daemon.files import write_atomically
from twin_daemon.hand import HandDescription
from twin_daemon.resources import state_dir
from twin_daemon.security.identity import ANONYMOUS, INTERNAL, Keyring, keys_file, load_keyring
from twin_daemon.security.tls import DAEMON, is_tls, shown_by_daemon

PUBLIC = (ANONYMOUS, ANONYMOUS)
"""What everybody may use who has no identity; it looks where looking is free."""
_LOOK = ("state", "residual", "version", "versions", "drift", "model", "events", "health", "diagnosis", "recalibration")
_WORK = ("keep", "diagnose")  # they write to the disk, or take the machine's time


def credentials(name: str | None = None) -> tuple[str, str]:
    """User and password of an identity of the key file; by default that of TWIN_AS, else the public ones."""
    name = name or os.environ.get("TWIN_AS")
    if not name:
        return PUBLIC
    path = keys_file(state_dir())
    keyring = load_keyring(path)
    if name not in keyring:
        raise BadInput(f"no identity '{name}'", where=path, todo="Name one of the file with --as or TWIN_AS")
    return name, keyring.password(name)


def access_of(
    settings: AccessSettings | None,
    address: str,
    keyring: Keyring,
    description: HandDescription,
    folder: Path,
    ros: RosKeys | None = None,
) -> dict[str, Any] | None:
    """What the router at `address` enforces, as Zenoh's keys; None without access control. Raises BadInput where it
    does not fit the settings."""
    require_fitting(settings, address)
    if settings is None:
        return None
    if settings.certificates:
        return certified_access(keyring, description, ros)
    return router_access(keyring, description, folder / "passwords", settings.anonymous == "look", ros)


def require_fitting(settings: AccessSettings | None, address: str) -> None:
    """Raises BadInput where certificates are asked for without TLS, or the other way round."""
    certified = settings is not None and settings.certificates
    if certified != is_tls(address):
        raise BadInput(
            "certificates need a tls/ endpoint" if certified else "a tls/ endpoint needs certificates",
            where=address,
            todo="Set access: {certificates: true} and endpoint: tls/HOST:PORT together; see docs/security.md",
        )


def daemon_login(settings: AccessSettings | None, keyring: Keyring) -> dict[str, Any] | None:
    """How the daemon logs in at its gate's router, as Zenoh's keys; None where that router asks nobody."""
    if settings is None:
        return None
    if settings.certificates:
        return shown_by_daemon()
    password = keyring.among_ourselves().password(INTERNAL)
    return {"transport/auth/usrpwd": {"user": INTERNAL, "password": password}}


def certified_access(keyring: Keyring, description: HandDescription, ros: RosKeys | None = None) -> dict[str, Any]:
    """The router's configuration where each identity shows its certificate. One whose identity was removed from the
    keyring may do nothing, however long its certificate lasts."""
    return {**shown_by_daemon(), "access_control": _rules(keyring, description, ros, "cert_common_names")}


def router_access(
    keyring: Keyring,
    description: HandDescription,
    passwords: Path,
    anonymous_looks: bool,
    ros: RosKeys | None = None,
) -> dict[str, Any]:
    """The router's configuration for the identities of a keyring. Writes the file of passwords that it refers to."""
    users = {name: keyring.password(name) for name in keyring.names}
    users[INTERNAL] = keyring.among_ourselves().password(INTERNAL)
    if anonymous_looks:
        users[PUBLIC[0]] = PUBLIC[1]
    passwords.parent.mkdir(parents=True, exist_ok=True)
    lines = "".join(f"{name}:{password}\n" for name, password in users.items())
    write_atomically(passwords, lines.encode(), mode=0o600)
    return {
        "transport/auth/usrpwd": {"dictionary_file": str(passwords)},
        "access_control": _rules(keyring, description, ros, "usernames"),
    }


def _rules(keyring: Keyring, description: HandDescription, ros: RosKeys | None, known_by: str) -> dict[str, Any]:
    """`known_by` is what tells the identities apart: usernames, which the public one has too, or cert_common_names."""

    def command(verb: str) -> str:
        return description.key("command", verb=verb)

    streams = [*heard_keys(description).values(), *(ros.subscribed.values() if ros is not None else ())]
    told = [description.key(name) for name in ("twin_joint_states", "residual", "events", "health", "announcement")]
    told += [ros.published] if ros is not None else []
    asked = [*(description.key(name) for name in _LOOK), command("status"), command("stop"), command("cancel")]
    work = [description.key(name) for name in _WORK]
    alive = [description.key("alive"), description.keys.alive.format(ns="**")]  # who looks for hands asks for all
    own_stop = [description.key("driver_stop"), *filter(None, [description.stop and description.stop.zenoh_key])]
    between = [description.key("gate", verb=verb) for verb in ("told", "beat", "recalibrate", "serves")]
    everything = [*between, *streams, *told, *asked, *work, *own_stop, command("*"), description.key("alive")]
    rules = [
        _rule("answers", "egress", ["put", "reply", "liveliness_token", "declare_queryable", "query"], everything),
        # what the daemon subscribes to, letter by letter: a wildcard that no rule covers would leave it deaf
        _rule("interest", "egress", ["declare_subscriber"], [*everything, *daemon_subscribes(description, ros)]),
        _rule("listen", "ingress", ["declare_subscriber"], [*streams, *told, command("sent")]),
        _rule("see", "ingress", ["liveliness_query", "declare_liveliness_subscriber"], alive),
        _rule("ask", "ingress", ["query"], asked),
        _rule("work", "ingress", ["query"], work),
        _rule("command", "ingress", ["query"], [command("*")]),
        _rule("stream", "ingress", ["put"], [command("target"), command("beat")]),
        _rule("stop", "ingress", ["put"], [command("stop"), command("cancel")]),
        _rule("speak", "ingress", ["put"], streams),
        _rule(
            "daemon",
            "ingress",
            [
                "put",
                "query",
                "reply",
                "declare_subscriber",
                "declare_queryable",
                "liveliness_token",
                "liveliness_query",
                "declare_liveliness_subscriber",
            ],
            [*everything, *daemon_subscribes(description, ros), *alive],
        ),
        _rule("serve", "ingress", ["declare_subscriber", "declare_queryable", "reply"], own_stop),
    ]
    anybody = {} if known_by == "usernames" else {known_by: list(keyring.names)}
    subjects: list[dict[str, Any]] = [{"id": "all", **anybody}]
    policies: list[dict[str, Any]] = [
        {"rules": ["answers", "interest", "listen", "see", "ask", "stop"], "subjects": ["all"]},
    ]
    for role, allowed in {"operator": ["work", "command", "stream"], "hand": ["speak", "serve"]}.items():
        names = [name for name in keyring.names if keyring.role(name) == role]
        if names:
            subjects.append({"id": role, known_by: names})
            policies.append({"rules": allowed, "subjects": [role]})
    subjects.append({"id": "daemon", known_by: [INTERNAL if known_by == "usernames" else DAEMON]})
    policies.append({"rules": ["answers", "interest", "daemon"], "subjects": ["daemon"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rule(name: str, flow: str, messages: list[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}
