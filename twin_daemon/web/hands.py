"""The hands that one workbench shows: its own, or all that are on the network."""

from __future__ import annotations

import logging
import threading
from dataclasses import dataclass, replace
from typing import Any

from pydantic import ValidationError

from bridges.zenoh.connection import Connection
from bridges.zenoh.fleet import MOST_HANDS, SILENT, HandSeen, look
from twin_daemon.errors import BadInput, NoAnswer
from twin_daemon.hand import HandDescription
from twin_daemon.services.guard import Guard
from twin_daemon.web.live import Live
from twin_daemon.web.scene import Scene

log = logging.getLogger(__name__)

AWAY = "away"
"""The status of a hand that was seen, and whose daemon is gone."""

_LOOK_EVERY_S = 1.0


@dataclass(frozen=True)
class View:
    """One hand as the page shows it. `own`: the recordings and versions of this workbench are of such a hand.

    Without a `scene` (another hand's model is not here) it is not shown in space.
    """

    description: HandDescription
    live: Live
    scene: Scene | None
    own: bool


class Hands:
    """Live links, from `start` to `close`; with `fleet` one to each hand on the network that somebody looked at."""

    def __init__(self, own: HandDescription, scene: Scene, endpoint: str, *, fleet: bool) -> None:
        self.fleet = fleet
        self._own = own
        self._scene = scene
        self._endpoint = endpoint
        self._guard = Guard(log)
        self._lock = threading.Lock()
        self._seen: dict[str, HandSeen] = {}
        self._views: dict[str, View] = {}
        self._ended = threading.Event()
        self._connection: Connection | None = None
        self._watch: threading.Thread | None = None

    def start(self) -> None:
        self._connection = Connection(self._endpoint)
        if not self.fleet:
            self.view(self._own.namespace)  # so that its last seconds are there when somebody looks
        else:
            self._watch = threading.Thread(target=self._look_round, name="twin-fleet", daemon=True)
            self._watch.start()

    def close(self) -> None:
        self._ended.set()
        if self._watch is not None:
            self._watch.join()
        with self._lock:
            views, self._views = list(self._views.values()), {}
        for view in views:
            view.live.close()
        if self._connection is not None:
            self._connection.close()

    def view(self, namespace: str | None = None) -> View:
        """A hand by its namespace; without one the workbench's own, or the first that is there where that is not.

        Raises BadInput for one that was never seen, NoAnswer for one that never said which joints it has.
        """
        with self._lock:
            namespace = namespace or self._first()
            if namespace not in self._views:
                self._views[namespace] = self._made(namespace)
            return self._views[namespace]

    def addressed(self, namespace: object) -> Live:
        """The hand that a request means. With a fleet it has to say so: nothing is stopped or kept by default."""
        if namespace is None and self.fleet:
            raise BadInput("the request does not say which hand it means", allowed=self._known())
        return self.view(None if namespace is None else str(namespace)).live

    def listed(self) -> list[dict[str, Any]]:
        """The hands that were seen since the start, with their state, as plain objects; none without `fleet`."""
        with self._lock:
            return [
                {
                    "namespace": namespace,
                    "status": one.status,
                    "drifting_joints": one.drifting_joints,
                    "worst_joint": one.worst_joint,
                    "worst_rmse_rad": one.worst_rmse_rad,
                }
                for namespace, one in sorted(self._seen.items())
            ]

    def _first(self) -> str:
        own = self._own.namespace
        return own if own in self._seen or not self._seen else min(self._seen)

    def _known(self) -> str:
        return ", ".join(sorted({self._own.namespace, *self._seen}))

    def _made(self, namespace: str) -> View:
        seen = self._seen.get(namespace)
        if namespace != self._own.namespace and seen is None:
            raise BadInput(f"no hand '{namespace}' has been seen", allowed=self._known())
        expected = namespace == self._own.namespace and (seen is None or not seen.joints)
        own = expected or (seen is not None and self._is_own(seen))
        if own:
            description = self._own.model_copy(update={"namespace": namespace})
        elif seen is not None and seen.joints:
            description = _by_its_own_words(namespace, seen)
        else:
            raise NoAnswer(f"the daemon of {namespace} is there, but does not answer", todo="Look at its log")
        if self._connection is None or self._ended.is_set():
            raise NoAnswer("the workbench stops")
        live = Live(description, self._endpoint)
        live.start(self._connection)
        return View(description, live, self._scene if own else None, own)

    def _is_own(self, seen: HandSeen) -> bool:
        return seen.hand == self._own.name and set(seen.joints) == set(self._own.joints)

    def _look_round(self) -> None:
        while not self._ended.wait(_LOOK_EVERY_S):
            self._guard.run("looking for hands", self._look)

    def _look(self) -> None:
        session = self._connection.session if self._connection is not None else None
        found = look(session) if session is not None else {}
        with self._lock:
            away = {name: replace(one, status=AWAY) for name, one in self._seen.items() if name not in found}
            if len(away) + len(found) > MOST_HANDS:
                away = {}
            for name, one in found.items():
                if one.status == SILENT and name in self._seen:
                    found[name] = replace(self._seen[name], status=SILENT)
            self._seen = away | found


def _by_its_own_words(namespace: str, seen: HandSeen) -> HandDescription:
    """What the live view needs of a hand whose description is not here: its name and joints. Raises BadInput."""
    joints = dict.fromkeys(seen.joints)
    try:
        return HandDescription.model_validate(
            {"schema": 1, "name": seen.hand, "model": "unknown", "namespace": namespace, "joints": joints}
        )
    except ValidationError as error:
        raise BadInput(f"what it says of itself cannot be shown: {error.errors()[0]['msg']}", where=namespace) from None
