"""A promoted version is read beside the loop, and is ready when the loop takes it up."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from twin_daemon.daemon.models import ModelSource
from twin_daemon.errors import TwinError
from twin_daemon.simulation.twin import TwinModel

log = logging.getLogger("twin")

_POLL_S = 0.5
Prepared = TypeVar("Prepared")


class Promotions(Generic[Prepared]):
    """Polls a model source in a thread of its own, and has `prepare` make ready what was promoted there.

    `take` gives it, once.
    """

    def __init__(self, source: ModelSource, prepare: Callable[[TwinModel], Prepared]) -> None:
        self._source = source
        self._prepare = prepare
        self._found: SimpleQueue[tuple[Prepared, dict[str, Any]]] = SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="twin-versions", daemon=True)
        self._thread.start()

    def take(self) -> tuple[Prepared, dict[str, Any]] | None:
        """The newest version that was promoted and not taken yet."""
        newest = None
        try:
            while True:
                newest = self._found.get_nowait()
        except Empty:
            return newest

    def close(self) -> None:
        self._stop.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._stop.wait(_POLL_S):
            try:
                found = self._source.poll()
                if found is not None:
                    self._found.put((self._prepare(found[0]), found[1]))
            except TwinError as error:
                log.warning("the promoted version is not used: %s", error.line())
            except Exception as error:
                log.warning("the promoted version is not used: %r", error)
