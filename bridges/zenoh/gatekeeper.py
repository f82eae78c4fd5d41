"""The gate on Zenoh: requests in, replies out, and a clock that turns it while it is armed."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import zenoh

from bridges.zenoh.command_publisher import CommandPublisher
from bridges.zenoh.driver_stop import DriverStop
from bridges.zenoh.sources import Sources
from twin_daemon.gate.asked import NOTHING_SENT
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.requests import KINDS, BadRequest, read_request
from twin_daemon.hand import HandDescription
from twin_daemon.security.identity import Keyring, Proof, Who
from twin_daemon.services.durations import Durations
from twin_daemon.services.guard import Guard
from twin_daemon.services.register import Register

log = logging.getLogger("twin.gate")

_IDLE_S = 0.5
_AFTER_STOP_S = 1.0  # it is told, too, when the hand moves on


class Gatekeeper:
    """Serves `command/<verb>` and turns the gate in a thread of its own.

    A request is the JSON of its verb, with a proof of who asks as the attachment; the reply says accepted or refused
    and why, with a proof of it under the key of who asked. `command/target`, `beat` and `stop` can be put as well as
    asked. `recalibrate` begins a recalibration in the name of who asks, or says why not.
    """

    def __init__(
        self,
        session: zenoh.Session,
        gate: Gate,
        register: Register,
        keyring: Keyring,
        description: HandDescription,
        recalibrate: Callable[[str], str | None] = lambda _: "this daemon does not recalibrate",
        daemon_silent_s: Callable[[float], float] = lambda _: 0.0,
    ) -> None:
        self.gate = gate
        gate.audit_sink, gate.clock = register, time.monotonic
        self._register = register
        self._keyring = keyring
        self._recalibrate = recalibrate
        self._daemon_silent_s = daemon_silent_s
        self._key = lambda verb: description.key("command", verb=verb)
        self._guard = Guard(log)
        self._turn_s, self._request_s = Durations(), Durations()
        self._publisher = CommandPublisher(session, description)
        self._driver_stop = DriverStop(session, description)
        self._look_again_s: float | None = None
        gate.own_source, gate.names_source = self._publisher.source, Sources(session).named
        self._turned_s = time.monotonic()
        self._stop, self._wake = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._turns, name="twin-gate", daemon=True)
        self._thread.start()
        self._entities: list[Any] = [
            # one each, because each has a thread: a stop must not wait until a long trajectory has been looked at
            *(session.declare_queryable(self._key(verb), self._reply) for verb in (*KINDS, "status")),
            *(
                session.declare_subscriber(self._key(verb), partial(self._put, verb))
                for verb in ("target", "beat", "stop")
            ),
        ]

    def status(self) -> dict[str, Any]:
        """The gate's state, as `command/status` tells it to anybody."""
        cost_s = self._turn_s.told("turn") | self._request_s.told("request")
        now_s = time.monotonic()
        return {
            "schema": 1,
            **self.gate.status(now_s),
            **self.gate.movement.look(now_s),
            "driver_stop": self._driver_stop.told(),
            "errors": self._guard.errors,
            "cost": cost_s,
        }

    def turns(self, within_s: float) -> bool:
        """Whether the gate's thread has come round in the last `within_s`; one that hangs or has ended does not."""
        return time.monotonic() - self._turned_s < within_s

    def close(self) -> None:
        """Ends what is under way, lets it come to rest, and withdraws."""
        for entity in self._entities:
            entity.undeclare()
        self._stop.set()
        self._wake.set()
        self._thread.join()
        self._publisher.close()

    # -- requests ------------------------------------------------------------------------------------------

    def _reply(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        if "*" in key:  # to ask for everything is to look, and looking commands nothing
            with query:
                return
        verb = key.rpartition("/")[2]
        try:
            with query:
                payload = b"" if query.payload is None else query.payload.to_bytes()
                proof = _proof(query.attachment)
                answer = json.dumps(self._answer(verb, payload, proof), allow_nan=False).encode()
                query.reply(
                    key, answer, encoding="application/json", attachment=self._proved(verb, payload, proof, answer)
                )
        except Exception as error:
            self._guard.failed(f"the answer to {verb}", error)

    def _proved(self, verb: str, payload: bytes, proof: Proof | None, answer: bytes) -> bytes | None:
        """What shows who asked that the gate has answered; None where there is no key to do it with."""
        if proof is None or self._keyring.who(verb, payload, proof) is None:
            return None
        return self._keyring.answer_proof(proof.who, verb, payload, answer).encode()

    def _put(self, verb: str, sample: zenoh.Sample) -> None:
        payload, proof = sample.payload.to_bytes(), _proof(sample.attachment)
        self._guard.run(f"a {verb} that was put", self._answer, verb, payload, proof)

    def _answer(self, verb: str, payload: bytes, proof: Proof | None) -> dict[str, Any]:
        began_s = time.thread_time()  # the processor's time: what others take of the machine is theirs
        if verb == "status":
            return self.status()
        if verb == "stop":
            self._guard.run("the stop of the hand's driver", self._driver_stop.call)
        try:
            request = read_request(verb, payload)
        except BadRequest as error:
            return {
                "schema": 1,
                "verb": verb,
                "accepted": False,
                "check": "request",
                "why": str(error),
                "allowed": "the JSON of this request",
                "consequence": NOTHING_SENT,
            }
        who = self._keyring.who(verb, payload, proof)
        if verb == "arm" and self._daemon_silent_s(time.monotonic()) > self.gate.settings.state_timeout_s:
            return self._without_daemon(who)
        answer = self.gate.ask(verb, request, who, time.monotonic(), time.time_ns())
        if verb == "stop":
            answer |= {"driver_stop": self._driver_stop.told()}
            self._look_again_s = self._look_again_s or time.monotonic() + _AFTER_STOP_S
        self._wake.set()
        if verb == "recalibrate" and answer["accepted"] and who is not None:
            why = self._recalibrate(who.name)
            if why is not None:
                answer |= {"accepted": False, "check": "recalibration", "why": why, "consequence": "nothing changes"}
        if verb == "target":
            self._request_s.add(time.thread_time() - began_s)
        self._guard.run("the events", self._register.tell)
        if answer["accepted"] and verb not in ("target", "beat"):
            self._guard.run("the audit log", self._register.sync)
        return answer

    def _without_daemon(self, who: Who | None) -> dict[str, Any]:
        """Refuses to arm: nobody would follow the hand, or tell what it does."""
        why = "the twin's daemon is not heard"
        entry = {"verb": "arm", "who": who.name if who else None, "accepted": False, "check": "daemon", "why": why}
        self._guard.run("the audit log", self._register, entry)
        return {
            "schema": 1,
            **entry,
            "allowed": "a running 'twin run'",
            "consequence": NOTHING_SENT,
            "gate": self.gate.status(time.monotonic()),
        }

    # -- turns ---------------------------------------------------------------------------------------------

    def _turns(self) -> None:
        period_s = 1.0 / self.gate.settings.rate_hz
        next_s = time.monotonic()
        while True:
            now_s = time.monotonic()
            if self._stop.is_set() and (not self.gate.active or now_s > next_s + _IDLE_S):
                return
            if self._stop.is_set():
                self.gate.end("closed", "the daemon ends", now_s)
            if not self.gate.active:
                self._turn(now_s)
                self._wake.wait(_IDLE_S)
                self._wake.clear()
                next_s = time.monotonic()
                continue
            self._turn(now_s)
            next_s = max(next_s + period_s, now_s)
            time.sleep(max(next_s - time.monotonic(), 0.0))

    def _after_stop(self, now_s: float) -> None:
        """A second after a stop: whether the hand moves on, for the record."""
        if self._look_again_s is None or now_s < self._look_again_s:
            return
        self._look_again_s = None
        found = self.gate.movement.look(now_s)
        if found["hand_moves"]:
            joints = ", ".join(found["moved_rad"])
            why = f"a second after the stop the hand still moves ({joints}): somebody else drives it"
            entry = {
                "verb": "stopped",
                "who": None,
                "accepted": True,
                "check": "still_moves",
                "why": why,
                "again": True,
            }
            self._register(entry)

    def _turn(self, now_s: float) -> None:
        self._turned_s = now_s
        self._guard.run("the look after a stop", self._after_stop, now_s)
        began_s = time.thread_time()
        try:
            silent_s = self._daemon_silent_s(now_s)
            if silent_s > self.gate.settings.state_timeout_s:
                self.gate.end("daemon", f"the daemon has been silent for {silent_s:.2f} s", now_s)
            command = self.gate.turn(now_s, time.time_ns())
            if command is not None:
                self._publisher.send(command)
                self._turn_s.add(time.thread_time() - began_s)
            self._register.tell()
        except Exception as error:
            self._guard.failed("a turn of the gate", error)
            self.gate.fault(f"the gate failed: {error!r:.200}", now_s)


def _proof(attachment: zenoh.ZBytes | None) -> Proof | None:
    """None where none was given; one that proves nothing where it cannot be read."""
    return None if attachment is None else Proof.decode(attachment.to_bytes()) or Proof("", "")
