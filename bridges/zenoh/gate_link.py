"""What gate and daemon say to each other: two processes, each of which must notice when the other one is gone.

The gate tells what it decides and how it is; the daemon says that it is there, and begins what is asked of it. Both
hold the same file of keys, and what does not prove that counts for nothing.
"""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

from bridges.zenoh.asking import ask_everybody
from twin_daemon.hand import HandDescription
from twin_daemon.security.identity import INTERNAL, Keyring, Proof
from twin_daemon.security.signer import Signer
from twin_daemon.services.guard import Guard

log = logging.getLogger("twin.gate")

BEAT_S = 0.01
"""Between two signs of life of the daemon."""
STATUS_S = 0.25
_LOOP_S = 1.0  # a loop that has not come round for so long is no sign of life
_ANSWER_S = 10.0
Tell = Callable[[str, str, dict[str, Any]], None]


class _Heard:
    """Opens what one side puts: proved, and newer than what came before."""

    def __init__(self, keyring: Keyring) -> None:
        self._keyring = keyring
        self._last: dict[str, int] = {}

    def opened(self, what: str, said: zenoh.Sample | zenoh.Query) -> dict[str, Any] | None:
        payload, attached = b"" if said.payload is None else said.payload.to_bytes(), said.attachment
        proof = None if attached is None else Proof.decode(attached.to_bytes())
        who = self._keyring.who(what, payload, proof)
        if who is None or who.name != INTERNAL:
            return None
        told = json.loads(payload)
        if told["sequence"] <= self._last.get(what, 0):
            return None
        self._last[what] = told["sequence"]
        return told


class GateEnd:
    """The gate's end. `silent_s` says how long the daemon has not been heard."""

    def __init__(self, session: zenoh.Session, description: HandDescription, keyring: Keyring) -> None:
        self._session = session
        self._own = keyring.among_ourselves()
        self._signer = Signer(self._own, INTERNAL)
        self._recalibrate = description.key("gate", verb="recalibrate")
        self._heard = _Heard(self._own)
        self._beat_s: float | None = None
        self._told = session.declare_publisher(
            description.key("gate", verb="told"), congestion_control=zenoh.CongestionControl.DROP, express=True
        )
        self._guard = Guard(log)
        beat = self._guard.around("a sign of life of the daemon", self._beat)
        self._entities: list[Any] = [
            session.declare_subscriber(description.key("gate", verb="beat"), beat),
            session.liveliness().declare_token(description.key("gate", verb="serves")),
        ]

    def _beat(self, sample: zenoh.Sample) -> None:
        if self._heard.opened("beat", sample) is not None:
            self._beat_s = time.monotonic()

    def silent_s(self, now_s: float) -> float:
        """Infinite before the daemon's first sign of life."""
        return float("inf") if self._beat_s is None else now_s - self._beat_s

    def tell(self, kind: str, text: str, data: dict[str, Any]) -> None:
        """An event, for the daemon's log and for those who listen to it."""
        self._put({"kind": kind, "text": text, "data": data})

    def tell_status(self, status: dict[str, Any]) -> None:
        self._put({"status": status})

    def _put(self, body: dict[str, Any]) -> None:
        payload, proof = self._signer.signed("told", body)
        self._told.put(payload, attachment=proof)

    def recalibrate(self, who: str, status: dict[str, Any]) -> str | None:
        """Lets the daemon begin a recalibration in somebody's name; why not, if not. It judges by this status of the
        gate: the one that it was told last is older."""
        payload, proof = self._signer.signed("recalibrate", {"who": who, "status": status})

        def proves(content: bytes, attachment: bytes | None) -> bool:
            return self._signer.proves("recalibrate", payload, content, attachment)

        told = ask_everybody(self._session, self._recalibrate, payload, proof, _ANSWER_S, proves)
        if told is None or not told["proved"]:
            return "the daemon does not answer"
        return None if told["why"] is None else str(told["why"])

    def close(self) -> None:
        for entity in (*self._entities, self._told):
            entity.undeclare()


class DaemonEnd:
    """The daemon's end, with a thread that says it is there, as long as `turned` keeps coming."""

    def __init__(
        self,
        session: zenoh.Session,
        description: HandDescription,
        keyring: Keyring,
        tell: Tell,
        recalibrate: Callable[[str], str | None],
    ) -> None:
        self._own = keyring.among_ourselves()
        self._signer = Signer(self._own, INTERNAL)
        self._heard = _Heard(self._own)
        self._tell = tell
        self._begin = recalibrate
        self._status: dict[str, Any] | None = None
        self._guard = Guard(log)
        self._turned_s = time.monotonic()
        self._key = description.key("gate", verb="recalibrate")
        self._beats = session.declare_publisher(
            description.key("gate", verb="beat"),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )
        told = self._guard.around("what the gate tells", self._told)
        self._entities: list[Any] = [
            session.declare_subscriber(description.key("gate", verb="told"), told),
            session.declare_queryable(self._key, self._guard.around("a recalibration", self._asked)),
        ]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="twin-alive", daemon=True)
        self._thread.start()

    def status(self) -> dict[str, Any] | None:
        """The gate's last word of itself; None before the first."""
        return self._status

    def turned(self) -> None:
        """The daemon's loop has come round."""
        self._turned_s = time.monotonic()

    def _beat(self) -> None:
        while not self._stop.wait(BEAT_S):
            if time.monotonic() - self._turned_s < _LOOP_S:
                payload, proof = self._signer.signed("beat", {})
                self._guard.run("a sign of life", self._put, payload, proof)

    def _put(self, payload: bytes, proof: bytes | None) -> None:
        self._beats.put(payload, attachment=proof)

    def _told(self, sample: zenoh.Sample) -> None:
        told = self._heard.opened("told", sample)
        if told is None:
            return
        if "status" in told:
            self._status = told["status"]
        else:
            self._tell(told["kind"], told["text"], told["data"])

    def _asked(self, query: zenoh.Query) -> None:
        with query:
            asked = self._heard.opened("recalibrate", query)
            if asked is None or query.payload is None:
                return
            self._status = asked["status"]
            answer = json.dumps({"why": self._begin(str(asked["who"]))}).encode()
            signed = self._own.answer_proof(INTERNAL, "recalibrate", query.payload.to_bytes(), answer).encode()
            query.reply(self._key, answer, attachment=signed)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        for entity in (*self._entities, self._beats):
            entity.undeclare()
