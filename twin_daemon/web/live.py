"""The page on the network: a client of the daemon like any other, in a process of its own."""

from __future__ import annotations

import json
import logging
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, Literal

import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander, cancel_automatic, who_stops
from bridges.zenoh.connection import Connection
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import MalformedPayload
from twin_daemon.errors import BadInput, NoAnswer, TwinError
from twin_daemon.hand import HandDescription
from twin_daemon.resources import state_dir
from twin_daemon.security.identity import keyring_of, keys_file, load_keyring
from twin_daemon.services.guard import Guard
from twin_daemon.services.stop_report import OWN_STOP, in_words, is_safe
from twin_daemon.web.window import Window

log = logging.getLogger(__name__)

SILENT_S = 2.5
"""After so long without a word of the daemon it counts as away; its health comes every second."""

_ASK_EVERY_S = 5.0
_KEEP_S = 60.0
_EVENTS = 12
_OUTSIDE = 3  # quantities that a sentence may list

Presence = Literal["unreachable", "away", "waiting", "stale", "no_commands", "following"]


class Live:
    """Hears hand and twin from `start` to `close`; whoever is missing may come, go and come again."""

    def __init__(self, description: HandDescription, endpoint: str) -> None:
        self.window = Window(list(description.joints))
        self.endpoint = endpoint
        self._description = description
        self._guard = Guard(log)
        self._lock = threading.Lock()
        self._heard_s: float | None = None
        self._health: dict[str, Any] = {}
        self._announced: tuple[float, dict[str, Any]] = (0.0, {})
        self._answers: dict[str, dict[str, Any]] = {}
        self._events: list[dict[str, Any]] = []
        self._ended = threading.Event()
        self._ask_now = threading.Event()
        self._subscribers: list[Any] = []
        self._connection: Connection | None = None
        self._thread: threading.Thread | None = None

    def start(self, connection: Connection) -> None:
        """Hears through this connection, which stays its owner's."""
        self._connection = connection
        self._thread = threading.Thread(target=self._work, name="twin-workbench", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._ask_now.set()
        if self._thread is not None:
            self._thread.join()
        for subscriber in self._subscribers:
            subscriber.undeclare()

    # -- what is known -------------------------------------------------------------------------------------

    @property
    def presence(self) -> Presence:
        """Who is there: nobody at the endpoint, no daemon, or the daemon with the state that it is in."""
        if self._session is None:
            return "unreachable"
        if self._silent_s > SILENT_S:
            return "away"
        return self._health.get("status", "waiting")

    def about(self) -> dict[str, Any]:
        """All but the samples, as a plain object; `words` say it to people."""
        with self._lock:
            presence, health = self.presence, self._health
            drift, version, next_fit = (self._answers.get(n, {}) for n in ("drift", "version", "recalibration"))
            timing, loop = health.get("timing") or {}, health.get("loop") or {}
            return {
                "presence": presence,
                "words": self._words(presence, health.get("outside") or []),
                "version": health.get("version"),
                "version_title": version.get("title") or version.get("kind"),
                "recalibration": next_fit.get("words"),
                "gate": health.get("gate"),
                "automatic": self._moves_by_itself(),
                "drift": drift.get("verdict"),
                "drifting_joints": drift.get("drifting_joints", []),
                "age_s": health.get("age_s"),
                "rate_hz": timing.get("rate_hz"),
                "missing": timing.get("missing"),
                "late": timing.get("late"),
                "latency_p99_s": loop.get("latency_p99_s"),
                "dropped": loop.get("dropped"),
                "errors": loop.get("errors"),
                "uptime_s": health.get("uptime_s"),
                "refused": sum((health.get("joint_states") or {}).get("counts", {}).values()),
                "events": self._events[-_EVENTS:],
                "unreadable": self._guard.errors,
            }

    def _moves_by_itself(self) -> str | None:
        """What is announced, in words; None where nothing is, or nobody has said so lately."""
        heard_s, told = self._announced
        if told.get("phase", "none") == "none" or time.monotonic() - heard_s > SILENT_S:
            return None
        return str(told.get("words"))

    def _words(self, presence: Presence, outside: Sequence[str]) -> str:
        if presence == "unreachable":
            return (
                f"Nothing listens at {self.endpoint}. Start the daemon with 'twin run'; this page connects by itself."
            )
        if presence == "away":
            since = "has not been heard yet" if self._heard_s is None else f"has been silent for {self._silent_s:.0f} s"
            return (
                f"The daemon of {self._description.namespace} {since}. What is shown is the last that was heard; "
                "it goes on by itself when the daemon is back."
            )
        beyond = f" Outside of what this version has seen: {'; '.join(outside[:_OUTSIDE])}." if outside else ""
        return {
            "waiting": "The daemon runs, and waits for the hand's first joint state.",
            "stale": "The hand is silent: the daemon runs, but no joint states arrive.",
            "no_commands": "The hand is heard, but no command yet: the model holds the pose.",
            "following": f"The twin follows the hand and its commands.{beyond}",
        }.get(presence, presence)

    # -- what can be asked ---------------------------------------------------------------------------------

    def keep(self) -> dict[str, Any]:
        """Lets the daemon save its last minutes; its answer. Raises NoAnswer where it is away."""
        return ask(self._there(), self._description.key("keep"), _KEEP_S)

    def stop_hand(self, reason: str) -> dict[str, Any]:
        """What a stop did and did not, with `words` and `safe`; takes a second. Anybody may ask for it. Raises NoAnswer
        where nothing was stopped."""
        if self._session is None:
            raise NoAnswer("the gate cannot be reached: NOT stopped", todo=OWN_STOP)
        report = who_stops(self._session, self._description).stop(reason)
        return report | {"words": in_words(report), "safe": is_safe(report)}

    def cancel(self, reason: str) -> dict[str, Any]:
        """Cancels a motion that begins by itself; anybody may. Raises NoAnswer."""
        return cancel_automatic(self._there(), self._description, reason)

    def release_hand(self, reason: str, name: str = "", key: str = "") -> dict[str, Any]:
        """The gate's answer to a release in the name of a person who gives his own key, for this one request; without
        one, of the operator whose key is here. Raises BadInput where there is none."""
        if key:
            keyring = keyring_of(name, key)
        else:
            path = keys_file(state_dir())
            keyring = load_keyring(path)
            name = next((one for one in keyring.names if keyring.role(one) == "operator"), "")
            if not name:
                todo = "Give your name and your key, or release it with 'twin command release'"
                raise BadInput("no operator's key is here", where=path, todo=todo)
        return Commander(self._there(), self._description, keyring, name).ask("release", reason=reason)

    def _there(self) -> zenoh.Session:
        if self._session is None or self.presence == "away":
            raise NoAnswer("the daemon is away", where=self.endpoint, todo="Start it with 'twin run'")
        return self._session

    # -- hearing -------------------------------------------------------------------------------------------

    @property
    def _session(self) -> zenoh.Session | None:
        return self._connection.session if self._connection is not None else None

    @property
    def _silent_s(self) -> float:
        return float("inf") if self._heard_s is None else time.monotonic() - self._heard_s

    def _work(self) -> None:
        connection = self._connection
        while connection is not None and not self._ended.is_set() and not connection.wait(0.1):
            pass
        if self._session is None:
            return
        for name, handle in {
            "joint_states": self._on_measured,
            "twin_joint_states": self._on_predicted,
            "health": self._on_health,
            "events": self._on_event,
            "announcement": self._on_announcement,
        }.items():
            self._subscribers.append(self._subscribe(self._session, name, handle))
        while not self._ended.is_set():
            if self._silent_s <= SILENT_S:
                self._guard.run("a question to the daemon", self._ask, self._session)
            self._ask_now.wait(_ASK_EVERY_S)
            self._ask_now.clear()

    def _subscribe(self, session: zenoh.Session, name: str, handle: Any) -> Any:
        def heard(sample: zenoh.Sample) -> None:
            self._guard.run(f"a message of {name}", handle, sample.payload.to_bytes())

        return session.declare_subscriber(self._description.key(name), heard)

    def _on_measured(self, payload: bytes) -> None:
        with suppress(MalformedPayload):  # the daemon counts them
            sample = cdr.decode(payload)
            self.window.measured(sample.stamp_ns, sample.names, sample.position)

    def _on_predicted(self, payload: bytes) -> None:
        sample = cdr.decode(payload)
        self._heard_s = time.monotonic()
        self.window.predicted(sample.stamp_ns, sample.names, sample.position)

    def _on_health(self, payload: bytes) -> None:
        health = json.loads(payload)
        with self._lock:
            news = health.get("version") != self._health.get("version") or self._silent_s > SILENT_S
            self._health, self._heard_s = health, time.monotonic()
            self._events = list(health.get("events") or [])
        if news:
            self._ask_now.set()

    def _on_announcement(self, payload: bytes) -> None:
        self._announced = time.monotonic(), dict(json.loads(payload))

    def _on_event(self, payload: bytes) -> None:
        event = json.loads(payload)
        with self._lock:
            self._events = [*self._events[-_EVENTS:], event]
        self._ask_now.set()

    def _ask(self, session: zenoh.Session) -> None:
        with suppress(TwinError):
            for name in ("drift", "version", "recalibration"):
                found = ask(session, self._description.key(name), 1.0)
                with self._lock:
                    self._answers[name] = found
