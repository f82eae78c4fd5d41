"""The gate on Zenoh: requests in, replies out, and a clock that turns it while it is armed."""

from __future__ import annotations

import contextlib
import json
import logging
import threading
import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

import zenoh

from bridges.durations import Durations
from bridges.guard import Guard
from bridges.outlet import Outlet
from twin_daemon.gate.audit import AuditLog
from twin_daemon.gate.checks import NOTHING_SENT
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.identity import Keyring, Proof
from twin_daemon.gate.requests import KINDS, BadRequest, read_request
from twin_daemon.hand import HandDescription

log = logging.getLogger("twin.gate")

Tell = Callable[[str, str, dict[str, Any]], None]
_REPEAT_S = 1.0
_IDLE_S = 0.5


class Register:
    """What the gate decides, in the audit log and as events. Of refusals that repeat one a second is written."""

    def __init__(self, audit: AuditLog, tell: Tell) -> None:
        self._audit = audit
        self._tell = tell
        self._refused: dict[tuple[Any, ...], tuple[float, int]] = {}
        self._untold: SimpleQueue[dict[str, Any]] = SimpleQueue()

    def __call__(self, entry: dict[str, Any]) -> None:
        """Writes one decision. Raises OSError where the log cannot be written."""
        if not entry["accepted"]:
            same = (entry["who"], entry["verb"], entry["check"])
            written_s, unwritten = self._refused.get(same, (-_REPEAT_S, 0))
            now_s = time.monotonic()
            if now_s - written_s < _REPEAT_S:
                self._refused[same] = (written_s, unwritten + 1)
                return
            if len(self._refused) > 1000:  # names are free to invent
                self._refused.clear()
            self._refused[same] = (now_s, 0)
            entry = entry | {"repeated": unwritten} if unwritten else entry
        self._audit.write(time.time_ns(), {key: value for key, value in entry.items() if value is not None})
        # telling may wait for whoever waits for the gate: it is left for later
        self._untold.put(entry)

    def tell(self) -> None:
        """Makes events of what was written since the last call."""
        with contextlib.suppress(Empty):
            while True:
                entry = self._untold.get_nowait()
                data = {key: entry.get(key) for key in ("verb", "who", "accepted", "check")}
                self._tell("gate", _sentence(entry), data)

    def sync(self) -> None:
        """Makes what was written survive a loss of power."""
        self._audit.sync()


def _sentence(entry: dict[str, Any]) -> str:
    who, verb = entry["who"] or "somebody unknown", entry["verb"]
    if verb == "trip":
        return f"the motion of {who} has ended: {entry['why']}"
    said = f"{who}: {verb}"
    if entry.get("reason"):
        said += f" ({entry['reason']})"
    return said if entry["accepted"] else f"{said} refused: {entry['why']}"


class Gatekeeper:
    """Serves `command/<verb>` and turns the gate in a thread of its own.

    A request is the JSON of its verb, with a proof of who asks as the attachment; the reply says accepted or refused
    and why. `command/target` can be put as well as asked: a stream then needs no replies. `recalibrate` begins a
    recalibration in the name of who asks, or says why not.
    """

    def __init__(
        self,
        session: zenoh.Session,
        gate: Gate,
        register: Register,
        keyring: Keyring,
        description: HandDescription,
        recalibrate: Callable[[str], str | None] = lambda _: "this daemon does not recalibrate",
    ) -> None:
        self.gate = gate
        gate.witness = register
        self._register = register
        self._keyring = keyring
        self._recalibrate = recalibrate
        self._key = lambda verb: description.key("command", verb=verb)
        self._guard = Guard(log)
        self._turn_s, self._request_s = Durations(), Durations()
        self._outlet = Outlet(session, description)
        self._turned_s = time.monotonic()
        self._stop, self._wake = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._turns, name="twin-gate", daemon=True)
        self._thread.start()
        self._entities: list[Any] = [
            # one each, because each has a thread: a stop must not wait until a long trajectory has been looked at
            *(session.declare_queryable(self._key(verb), self._reply) for verb in (*KINDS, "status")),
            session.declare_subscriber(self._key("target"), self._streamed),
        ]

    def status(self) -> dict[str, Any]:
        """The gate's state, as `command/status` tells it to anybody."""
        cost_s = self._turn_s.told("turn") | self._request_s.told("request")
        return {"schema": 1, **self.gate.status(time.monotonic()), "errors": self._guard.errors, "cost": cost_s}

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
        self._outlet.close()

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
                answer = self._answer(verb, payload, _proof(query.attachment))
                query.reply(key, json.dumps(answer, allow_nan=False), encoding="application/json")
        except Exception as error:
            self._guard.failed(f"the answer to {verb}", error)

    def _streamed(self, sample: zenoh.Sample) -> None:
        payload, proof = sample.payload.to_bytes(), _proof(sample.attachment)
        self._guard.run("a streamed target", self._answer, "target", payload, proof)

    def _answer(self, verb: str, payload: bytes, proof: Proof | None) -> dict[str, Any]:
        began_s = time.thread_time()  # the processor's time: what others take of the machine is theirs
        if verb == "status":
            return self.status()
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
        answer = self.gate.ask(verb, request, who, time.monotonic(), time.time_ns())
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

    def _turn(self, now_s: float) -> None:
        self._turned_s = now_s
        began_s = time.thread_time()
        try:
            command = self.gate.turn(now_s, time.time_ns())
            if command is not None:
                self._outlet.send(command)
                self._turn_s.add(time.thread_time() - began_s)
            self._register.tell()
        except Exception as error:
            self._guard.failed("a turn of the gate", error)
            self.gate.fault(f"the gate failed: {error!r:.200}", now_s)


def _proof(attachment: zenoh.ZBytes | None) -> Proof | None:
    """None where none was given; one that proves nothing where it cannot be read."""
    return None if attachment is None else Proof.decode(attachment.to_bytes()) or Proof("", "")
