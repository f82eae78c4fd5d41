"""Somebody who commands a hand through its gate: asks, proves who he is, and keeps saying that he is there."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Iterator
from typing import Any

import zenoh

from bridges.zenoh.asking import ask_everybody, believed
from twin_daemon.errors import NoAnswer
from twin_daemon.hand import HandDescription
from twin_daemon.security.identity import Keyring
from twin_daemon.security.signer import Signer, keys_of_the_machine
from twin_daemon.services.guard import Guard
from twin_daemon.services.stop_report import AFTER_S, stop_report

BEAT_S = 0.008
"""Between two signs of life while a motion is under way: whoever speaks so often is missed as soon as a hand."""
_PATIENCE_S = 5.0
_PLANNING_S = 20.0


class Commander:
    """Requests in the name of `name`; without a keyring anonymous ones. Safe to use from several threads.

    With a key only replies that the gate has proved count as accepted.
    """

    def __init__(
        self, session: zenoh.Session, description: HandDescription, keyring: Keyring | None = None, name: str = ""
    ) -> None:
        self._session = session
        self._description = description
        self._signer = Signer(keyring, name)

    @property
    def lease(self) -> str:
        """What the reply to an arming told; "" without one. Requests that need it carry it."""
        return self._signer.lease

    @lease.setter
    def lease(self, lease: str) -> None:
        self._signer.lease = lease

    def status(self, timeout_s: float = _PATIENCE_S) -> dict[str, Any]:
        """The gate's state. Raises NoAnswer where no daemon is."""
        found = self._get("status", *self._signer.signed("status", {}), timeout_s)
        self._signer.learn(found)
        return found

    def ask(self, verb: str, timeout_s: float | None = None, **body: Any) -> dict[str, Any]:
        """The gate's reply. Raises NoAnswer; a refusal is a reply like any other."""
        timeout_s = timeout_s or (_PLANNING_S if verb in ("move", "trajectory") else _PATIENCE_S)
        if not self._signer.session:
            self.status(timeout_s)
        payload, proof = self._signer.signed(verb, body)
        answer = self._get(verb, payload, proof, timeout_s)
        self._signer.learn(answer)
        return answer

    def stop(self, reason: str, timeout_s: float = _PATIENCE_S) -> dict[str, Any]:
        """Stops, and says after a second what that did and what it did not (`stop_report`). Raises NoAnswer."""
        answer = self._get("stop", *self._signer.signed("stop", {"reason": reason}), timeout_s)
        time.sleep(AFTER_S)
        status = None
        with contextlib.suppress(NoAnswer):
            status = self.status(timeout_s)
        return stop_report(answer, status)

    def stream(self, publisher: zenoh.Publisher, targets: dict[str, float]) -> None:
        """Puts one target of a stream, rad by joint or command. Call `status` once before."""
        payload, proof = self._signer.signed("target", {"targets": targets})
        publisher.put(payload, attachment=proof)

    def stream_to(self) -> zenoh.Publisher:
        """The publisher that `stream` puts to; the caller undeclares it."""
        return self._session.declare_publisher(
            self._description.key("command", verb="target"),
            congestion_control=zenoh.CongestionControl.DROP,
            express=True,
        )

    @contextlib.contextmanager
    def beating(self, guard: Guard, period_s: float = BEAT_S) -> Iterator[None]:
        """Says that the commander is there, again and again, as long as this process lives."""
        ended = threading.Event()
        publisher = self._session.declare_publisher(
            self._description.key("command", verb="beat"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )

        def put() -> None:
            payload, proof = self._signer.signed("beat", {})
            publisher.put(payload, attachment=proof)

        def beat() -> None:
            while not ended.is_set():
                guard.run("a heartbeat", put)
                ended.wait(period_s)

        thread = threading.Thread(target=beat, name="twin-heartbeat", daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            publisher.undeclare()

    def _get(self, verb: str, payload: bytes, proof: bytes | None, timeout_s: float) -> dict[str, Any]:
        key = self._description.key("command", verb=verb)
        deadline_s = time.monotonic() + timeout_s

        def proves(content: bytes, attachment: bytes | None) -> bool:
            return self._signer.proves(verb, payload, content, attachment)

        while True:
            left_s = max(deadline_s - time.monotonic(), 0.05)
            anonymous = self._signer.anonymous
            told = ask_everybody(
                self._session, key, payload, proof, left_s, None if anonymous else proves, verb == "stop"
            )
            if told is not None:
                return told if anonymous else believed(told)
            if time.monotonic() >= deadline_s:
                raise NoAnswer(
                    f"nothing answered at {key}", todo="Is 'twin run' running? Same --hand, same --endpoint?"
                )
            time.sleep(0.05)


def who_stops(session: zenoh.Session, description: HandDescription) -> Commander:
    """Anybody at this machine who stops a hand, with the key that is at hand to check who answers."""
    return Commander(session, description, *keys_of_the_machine())


def cancel_automatic(session: zenoh.Session, description: HandDescription, reason: str) -> dict[str, Any]:
    """Cancels a motion of the twin's own; anybody may. `cancelled` says whether there was one. Raises NoAnswer."""
    key = description.key("command", verb="cancel")
    for reply in session.get(key, payload=json.dumps({"reason": reason}), timeout=_PATIENCE_S):
        if reply.ok is not None:
            return json.loads(reply.ok.payload.to_bytes())
    raise NoAnswer(f"nothing answered at {key}: NOT cancelled", todo="Use 'twin command stop', or the hand's own stop")
