"""What makes a request somebody's own: his name, the gate's present life, and a number that grows."""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Mapping
from typing import Any

from twin_daemon.errors import BadInput
from twin_daemon.resources import state_dir
from twin_daemon.security.identity import Keyring, Proof, keys_file, load_keyring

_WITHOUT_LEASE = ("stop", "release", "recalibrate", "cancel")


class Signer:
    """Makes requests in the name of `name`; without a keyring anonymous ones. Safe to use from several threads.

    `session` is the gate's own name for its present life, "" until the gate has told it. `lease` is what the reply to
    an arming told: requests that need it carry it.
    """

    def __init__(self, keyring: Keyring | None = None, name: str = "") -> None:
        self.session = ""
        self.lease = ""
        self._keyring = keyring
        self._name = name
        self._sequence = 0
        self._lock = threading.Lock()

    def learn(self, told: Mapping[str, Any]) -> None:
        """Takes the gate's session from its status, or from a reply, which carries it, and the lease of an arming."""
        self.lease = str(told.get("lease") or self.lease)
        status = told.get("gate") or told
        self.session = str(status.get("session") or self.session)

    def signed(self, verb: str, body: Mapping[str, Any], stamp_ns: int | None = None) -> tuple[bytes, bytes | None]:
        """The bytes of a request and their proof. `stamp_ns` is when it was asked, if that was not just now."""
        with self._lock:
            now_ns = time.time_ns()
            self._sequence = max(now_ns, self._sequence + 1)
            own: dict[str, Any] = {
                "session": self.session,
                "sequence": self._sequence,
                "stamp_ns": now_ns if stamp_ns is None else stamp_ns,
            }
            if self.lease and verb not in _WITHOUT_LEASE:
                own["lease"] = self.lease
        payload = json.dumps({**own, **body}).encode()
        if self._keyring is None:
            return payload, None
        return payload, self._keyring.sign(self._name, verb, payload).encode()

    @property
    def anonymous(self) -> bool:
        """Whether it has no key: then no reply can be proved to it."""
        return self._keyring is None

    def proves(self, verb: str, request: bytes, reply: bytes, attachment: bytes | None) -> bool:
        """Whether a reply to one of its requests is the gate's own."""
        if self._keyring is None or attachment is None:
            return False
        return self._keyring.proves_answer(self._name, verb, request, reply, Proof.decode(attachment))


def keys_of_the_machine() -> tuple[Keyring | None, str]:
    """In whose name anybody at this machine stops a hand: TWIN_AS, else a viewer, of the keys that can be read here.
    Without keys it is anonymous: a stop needs none, they only prove who answers it."""
    try:
        keyring = load_keyring(keys_file(state_dir()))
    except BadInput:
        return None, ""
    named = os.environ.get("TWIN_AS")
    if named and named in keyring:
        return keyring, named
    viewers = sorted(keyring.names, key=lambda name: keyring.role(name) != "viewer")
    return (keyring, viewers[0]) if viewers else (None, "")
