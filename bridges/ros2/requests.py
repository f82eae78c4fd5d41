"""Requests to the gate that nobody waits for: the answer goes to a callback. Knows nothing of ROS."""

from __future__ import annotations

import json
import logging
from collections import Counter
from collections.abc import Callable
from typing import Any

from bridges.ros2.conversions import gate_answer, refusal_line
from bridges.ros2.link import ZenohLink
from bridges.zenoh.asking import believed
from twin_daemon.hand import HandDescription
from twin_daemon.security.identity import ANONYMOUS
from twin_daemon.security.signer import Signer, keys_of_the_machine

log = logging.getLogger("twin.bridge")

ANSWER_S = 2.0
_PLANNING_S = 20.0  # of a long trajectory
Answered = Callable[[dict[str, Any]], None]


class Requests:
    """Asks in the name of one identity, and keeps count of what came of it.

    The first refusal of a kind is a warning, its repetitions are only counted. A stream has no replies: its
    refusals are taken from the daemon's events, which leave out those that repeat within a second.
    """

    def __init__(self, link: ZenohLink, description: HandDescription, signer: Signer, identity: str) -> None:
        self.counts: Counter[str] = Counter()
        self._link = link
        self._key = lambda verb: description.key("command", verb=verb)
        self._signer = signer
        self._stop_signer = signer
        self._name = identity or ANONYMOUS
        self._refusing: set[tuple[str, str]] = set()

    def look(self, then: Answered, timeout_s: float = ANSWER_S, after_stop: bool = False) -> None:
        """Asks for the gate's status; where nobody answers `then` gets a refusal."""

        def heard(status: dict[str, Any]) -> None:
            self._signer.learn(status)
            then(status)

        signer = self._stopper() if after_stop else self._signer
        self._sent("status", signer, *signer.signed("status", {}), timeout_s, heard)

    def _stopper(self) -> Signer:
        """Anybody may stop; a key only proves who has answered. The daemon may have made the keys meanwhile."""
        if self._stop_signer.anonymous:
            self._stop_signer = Signer(*keys_of_the_machine())
        return self._stop_signer

    def _sent(
        self, verb: str, signer: Signer, payload: bytes, proof: bytes | None, timeout_s: float, then: Answered
    ) -> None:
        key = self._key(verb)

        def heard(reply: bytes | None, proved: bool) -> None:
            answer = gate_answer(reply, key, timeout_s) | {"proved": proved}
            then(answer if signer.anonymous else believed(answer))

        def proves(content: bytes, attachment: bytes | None) -> bool:
            return signer.proves(verb, payload, content, attachment)

        self._link.ask_gate(
            key, timeout_s, heard, payload, proof, None if signer.anonymous else proves, urgent=verb == "stop"
        )

    def ask(
        self, verb: str, body: dict[str, Any], then: Answered = lambda _: None, stamp_ns: int | None = None
    ) -> None:
        """Asks for `verb`; `then` gets the gate's reply or, where there is none, a refusal that says so."""
        if self._signer.session or verb == "stop":  # a stop needs no session, and no delay
            self._send(verb, body, then, stamp_ns, again=verb != "stop")
            return

        def met(status: dict[str, Any]) -> None:
            if self._signer.session:
                self._send(verb, body, then, stamp_ns, again=False)
            else:
                self._noted(verb, status)
                then(status)

        self.look(met)

    def _send(self, verb: str, body: dict[str, Any], then: Answered, stamp_ns: int | None, again: bool) -> None:
        timeout_s = _PLANNING_S if verb == "trajectory" else ANSWER_S
        signer = self._stopper() if verb == "stop" else self._signer
        payload, proof = signer.signed(verb, body, stamp_ns)

        def heard(answer: dict[str, Any]) -> None:
            self._signer.learn(answer)
            if again and answer.get("check") == "session":  # the daemon is a new one, and has done nothing
                self._send(verb, body, then, stamp_ns, again=False)
                return
            self._noted(verb, answer)
            then(answer)

        self._sent(verb, signer, payload, proof, timeout_s, heard)

    def stream(self, body: dict[str, Any], stamp_ns: int | None) -> None:
        """Puts a streamed target, without waiting for anything."""
        sent = self._link.put_request(self._key("target"), *self._signer.signed("target", body, stamp_ns))
        self.counts[f"command.target.{'put' if sent else 'unsent'}"] += 1

    def heard_event(self, payload: bytes) -> None:
        """One event of the daemon, perhaps about what was asked here. Raises ValueError for no JSON."""
        told = json.loads(payload)
        if not isinstance(told, dict) or told.get("kind") != "gate" or told.get("who") != self._name:
            return
        if told.get("verb") == "trip":
            self.counts["command.ended"] += 1
            log.warning("%s", told.get("text"))
        elif told.get("verb") == "target":
            self._count("target", told.get("accepted") is True, str(told.get("check")), str(told.get("text")))

    def _noted(self, verb: str, answer: dict[str, Any]) -> None:
        line = f"{verb} over ROS 2 in the name of {self._name} refused: {refusal_line(answer)}"
        self._count(verb, answer.get("accepted") is True, str(answer.get("check")), line)

    def _count(self, verb: str, accepted: bool, check: str, line: str) -> None:
        self.counts[f"command.{verb}.{'accepted' if accepted else 'refused'}"] += 1
        if accepted:
            self._refusing = {(other, why) for other, why in self._refusing if other != verb}
            return
        log.log(logging.DEBUG if (verb, check) in self._refusing else logging.WARNING, "%s", line)
        self._refusing.add((verb, check))
