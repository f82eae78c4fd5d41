"""Zenoh sessions that find each other on loopback in any start order.

The daemon is the meeting point: it listens, as a router, so that what one process says reaches all others. Everyone
else is a client of that endpoint. Where a router is there already, or the address is another machine's, the daemon is
a client too. Nothing is announced on the network: no multicast, no gossip.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import re
import threading
import time
from typing import Any

import zenoh

from bridges.zenoh.access import credentials
from twin_daemon.errors import BadInput, NoAnswer, UsageError
from twin_daemon.security.tls import is_tls, shown_by_client
from twin_daemon.services.stop import Stoppable

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_ENDPOINT = re.compile(r"^(tcp|udp|tls|quic|ws|unixsock-stream)/\S+$")
_RETRY_S = 0.2
_ROUTER_S = 15.0  # a router elsewhere may start later; with five tries a minute systemd would give up


def choose_endpoint(given: str | None = None) -> str:
    """The endpoint of the command line or configuration, else TWIN_ENDPOINT, else loopback."""
    endpoint = given or os.environ.get("TWIN_ENDPOINT") or DEFAULT_ENDPOINT
    if not _ENDPOINT.match(endpoint):
        raise UsageError(
            f"'{endpoint}' is not a Zenoh endpoint", allowed="such as tcp/127.0.0.1:7447", todo="Correct --endpoint"
        )
    return endpoint


def session_config(
    mode: str,
    *,
    listen: list[str] | None = None,
    connect: list[str] | None = None,
    more: dict[str, Any] | None = None,
) -> zenoh.Config:
    """A configuration that talks to the named endpoints and to nobody else; `more` are further keys of Zenoh's."""
    config = zenoh.Config()
    for key, value in {
        "mode": mode,
        "listen/endpoints": listen or [],
        "connect/endpoints": connect or [],
        "connect/retry": {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 1.5},
        "transport/unicast/open_timeout": 3000,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,  # a router would wait half a second for others that it does not look for
        # at 1.5 kB a message it is slower, and its mlock fails under systemd's limits
        "transport/shared_memory/enabled": False,
        # a burst of a fast hand waits for the hop through the gate instead of being dropped
        "transport/link/tx/queue/size/data": 16,
        **(more or {}),
    }.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_client(
    endpoint: str, timeout_s: float | None, stop: Stoppable | None = None, name: str | None = None
) -> zenoh.Session | None:
    """A session at `endpoint` in the name of an identity; tries again until something listens there.

    None when `timeout_s` has passed (None: for ever) or `stop` is set. Once open, Zenoh itself reconnects.
    """
    if is_tls(endpoint):
        ways = itertools.cycle((shown_by_client(name),))
    else:
        user, password = credentials(name)
        # a router that asks for no password takes nobody who offers one: the two ways are tried in turn
        ways = itertools.cycle((None, {"transport/auth/usrpwd": {"user": user, "password": password}}))
    stop = stop or threading.Event()
    deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
    while not stop.is_set():
        try:
            return zenoh.open(session_config("client", connect=[endpoint], more=next(ways)))
        except zenoh.ZError:
            pass
        if deadline_s is not None and time.monotonic() >= deadline_s:
            return None
        stop.wait(0.5 * _RETRY_S)
    return None


def open_at_gate(endpoint: str, login: dict[str, Any] | None, stop: Stoppable, timeout_s: float) -> zenoh.Session:
    """The daemon's session with the router of its gate. Raises NoAnswer where it is not there in time."""
    deadline_s = time.monotonic() + timeout_s
    while not stop.is_set() and time.monotonic() < deadline_s:
        with contextlib.suppress(zenoh.ZError):
            return zenoh.open(session_config("client", connect=[endpoint], more=login))
        stop.wait(0.5 * _RETRY_S)
    raise NoAnswer("no gate answers", where=endpoint, todo="Start 'twin gate' with the same configuration")


def open_daemon(
    endpoint: str, access: dict[str, Any] | None = None, stop: Stoppable | None = None
) -> tuple[zenoh.Session, str]:
    """A session for the daemon, and whether it "listens" there or "joined" the router that was there already.

    With `access` its own router enforces it; a router that was there already has rules of its own. Raises NoAnswer
    where the address is another machine's and no router answers there.
    """
    try:
        return zenoh.open(session_config("router", listen=[endpoint], more=access)), "listens"
    except zenoh.ZError as error:
        elsewhere = "Cannot assign requested address" in str(error)
        if not elsewhere and "in use" not in str(error):
            raise BadInput(
                f"cannot listen: {error}".split(" at /")[0], where=endpoint, todo="Choose another --endpoint"
            ) from None
    if access is not None:
        raise BadInput(
            "a router of this daemon's own cannot listen there, and the rules of another one are not its to set",
            where=endpoint,
            todo="Choose another --endpoint, or leave 'access' out and let that router control it",
        )
    session = open_client(endpoint, _ROUTER_S if elsewhere else 2.0, stop)
    if session is None and elsewhere:
        raise NoAnswer(
            "this is another machine's address, and no router answers there",
            where=endpoint,
            todo="Start the router, or choose an --endpoint of this machine for the daemon to listen at",
        )
    if session is None:
        raise BadInput(
            "this address is in use by something that is not Zenoh",
            where=endpoint,
            todo="Stop that program, or choose another --endpoint (TWIN_ENDPOINT for all processes)",
        )
    return session, "joined"


def someone_serves(session: zenoh.Session, alive_key: str, timeout_s: float = 1.0) -> bool:
    """Whether a daemon has its liveliness token at this key."""
    return any(reply.ok for reply in session.liveliness().get(alive_key, timeout=timeout_s))
