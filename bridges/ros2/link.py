"""The bridge's Zenoh side: streams out, streams in, questions and requests. Knows nothing of ROS."""

from __future__ import annotations

import itertools
import logging
import os
import time
from collections import Counter
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any

import zenoh

from bridges.zenoh.asking import URGENT, Proves
from bridges.zenoh.connection import Connection
from bridges.zenoh.sources import Speaker
from twin_daemon.hand import HandDescription
from twin_daemon.services.inbox import Inbox

log = logging.getLogger("twin.bridge")

TO_THE_TWIN = ("joint_states", "joint_commands")
Then = Callable[[bytes | None], None]
Proved = Callable[[bytes | None, bool], None]

_GRACE_S = 0.5  # Zenoh ends a question by itself; this is for the case that it does not


class ZenohLink:
    """One connection with the twin, which comes when it comes and reconnects by itself.

    What arrives waits in `inbox` and in a queue of answers; `wake` is called from the transport's threads after each
    arrival. Everything else is called from one thread, the owner's. Where `identity` is not the one that the streams
    log in with (TWIN_AS), questions and requests have a session of their own: on the network, too, who speaks for the
    hand and who commands it are two.
    """

    def __init__(
        self, endpoint: str, description: HandDescription, wake: Callable[[], None], identity: str = ""
    ) -> None:
        self.endpoint = endpoint
        self.connected = False
        self.inbox = Inbox(size=1024)
        self.counts: Counter[str] = Counter()
        self._key = description.key
        self._wake = wake
        self._publishers: dict[str, Speaker] = {}
        self._hearers: dict[str, Callable[[bytes], None]] = {}
        self._subscribers: list[Any] = []
        self._answers: SimpleQueue[tuple[int, bytes | None, bool]] = SimpleQueue()
        self._questions: SimpleQueue[zenoh.Query] = SimpleQueue()
        self._served: dict[str, Callable[[zenoh.Query], None]] = {}
        self._numbers = itertools.count()
        self._open: dict[int, tuple[Proved, float]] = {}  # questions by number: what to do, until when
        self._connection = Connection(endpoint)
        another = identity and identity != os.environ.get("TWIN_AS")
        self._asking = Connection(endpoint, identity) if another else self._connection

    def hear(self, key: str, then: Callable[[bytes], None]) -> None:
        """`then`, which does not raise, gets what comes at `key`, from `settle`. Call it before the first `tend`."""
        self._hearers[key] = then

    def serve(self, key: str, then: Callable[[zenoh.Query], None]) -> None:
        """`then`, which does not raise, gets what is asked at `key`, from `settle`, and drops the query when it has
        answered. Call it before the first `tend`."""
        self._served[key] = then

    def tend(self) -> None:
        """Declares the streams as soon as there is a session, and notices when the other side goes or comes back.

        Call it every now and then.
        """
        session = self._connection.session
        if session is None:
            return
        if not self._publishers:
            self._declare(session)
        connected = bool(session.info.routers_zid() or session.info.peers_zid())
        if connected != self.connected:
            self.connected = connected
            level = logging.INFO if connected else logging.WARNING
            log.log(level, "%s the twin at %s", "connected with" if connected else "lost", self.endpoint)

    def _declare(self, session: zenoh.Session) -> None:
        self._subscribers = [self._subscribe(session, key) for key in self._hearers]
        self._subscribers += [session.declare_queryable(key, self._asked) for key in self._served]
        self._publishers = {
            stream: Speaker(
                session.declare_publisher(
                    self._key(stream), encoding="application/cdr", congestion_control=zenoh.CongestionControl.DROP
                )
            )
            for stream in TO_THE_TWIN
        }

    def _asked(self, query: zenoh.Query) -> None:
        self._questions.put(query)
        self._wake()

    def _subscribe(self, session: zenoh.Session, key: str) -> zenoh.Subscriber[None]:
        def receive(sample: zenoh.Sample) -> None:
            self.inbox.put(key, sample.payload.to_bytes())
            self._wake()

        return session.declare_subscriber(key, receive)

    def put(self, stream: str, payload: bytes, by: str = "") -> None:
        """Sends bytes as they are, with who they are from in words. Without a connection they are lost, and counted as
        unsent."""
        publisher = self._publishers.get(stream)
        if publisher is not None:
            publisher.put(payload, by)
        self.counts[f"{stream}.{'forwarded' if self.connected else 'unsent'}"] += 1

    def put_request(self, key: str, payload: bytes, proof: bytes | None) -> bool:
        """Sends a request that needs no answer; whether there was somebody to send it to."""
        session = self._asking.session or self._connection.session
        if session is None or not self.connected:
            return False
        session.put(key, payload, attachment=proof, congestion_control=zenoh.CongestionControl.DROP, express=True)
        return True

    def ask(self, key: str, timeout_s: float, then: Then) -> None:
        """Asks once. `then` gets the first answer's bytes, or None; from `settle`, or at once without a connection."""
        self.ask_gate(key, timeout_s, lambda payload, _: then(payload), None, None, None)

    def ask_gate(
        self,
        key: str,
        timeout_s: float,
        then: Proved,
        payload: bytes | None,
        proof: bytes | None,
        proves: Proves | None,
        urgent: bool = False,
    ) -> None:
        """Asks all who serve the key, once, so that nothing is ever commanded twice. `then` gets the bytes of the first
        answer that `proves` holds for, and True; else of the first that came.

        `then` is called from `settle`, or at once where there is no connection.
        """
        # a request is no worse for a session without a name, and a stop does not need one
        session = self._asking.session or self._connection.session
        if session is None:
            then(None, False)
            return
        number = next(self._numbers)
        unproved: list[bytes] = []
        self._open[number] = then, time.monotonic() + timeout_s + _GRACE_S

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                content, attached = reply.ok.payload.to_bytes(), reply.ok.attachment
                if proves is None or proves(content, None if attached is None else attached.to_bytes()):
                    self._answer(number, content, proves is not None)
                else:
                    unproved.append(content)
            elif reply.err is not None and (said := reply.err.payload.to_bytes()).startswith(b"{"):
                self._answer(number, said)  # other errors are the transport's own words, such as a timeout

        handler = zenoh.handlers.Callback(hear, lambda: self._answer(number, unproved[0] if unproved else None))
        session.get(
            key,
            handler,
            timeout=timeout_s,
            payload=payload,
            attachment=proof,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            **(URGENT if urgent else {}),
        )

    def _answer(self, number: int, payload: bytes | None, proved: bool = False) -> None:
        self._answers.put((number, payload, proved))
        self._wake()

    def settle(self) -> None:
        """Gives answers to those who asked, and what came on the streams to those who hear them."""
        while True:
            try:
                number, payload, proved = self._answers.get_nowait()
            except Empty:
                break
            if number in self._open:
                self._open.pop(number)[0](payload, proved)
        while not self._questions.empty():
            query = self._questions.get()
            self._served[str(query.key_expr)](query)
        now_s = time.monotonic()
        for number in [number for number, (_, end_s) in self._open.items() if now_s > end_s]:
            self._open.pop(number)[0](None, False)
        for key, heard, _, _ in self.inbox.take(timeout_s=0.0):
            self._hearers[key](heard)

    def give_up(self) -> int:
        """Answers every open question with None; how many there were."""
        given_up, self._open = list(self._open.values()), {}
        for then, _ in given_up:
            then(None, False)
        return len(given_up)

    def close(self) -> None:
        for entity in (*self._subscribers, *self._publishers.values()):
            entity.undeclare()
        if self._asking is not self._connection:
            self._asking.close()
        self._connection.close()
