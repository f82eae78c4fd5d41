"""A promoted version is read beside the loop, and is ready when the loop takes it up."""

from __future__ import annotations

import logging
import threading
from queue import Empty, SimpleQueue
from typing import Any

from twin_daemon.daemon.models import ModelSource
from twin_daemon.errors import TwinError
from twin_daemon.simulation.twin import TwinModel

log = logging.getLogger("twin")

_POLL_S = 0.5


class Promotions:
    """Polls a model source in a thread of its own. `take` gives what was promoted since, once."""

    def __init__(self, source: ModelSource) -> None:
        self._source = source
        self._found: SimpleQueue[tuple[TwinModel, dict[str, Any]]] = SimpleQueue()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="twin-versions", daemon=True)
        self._thread.start()

    def take(self) -> tuple[TwinModel, dict[str, Any]] | None:
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
            except TwinError as error:
                log.warning("the promoted version is not used: %s", error.line())
                continue
            except Exception as error:
                log.warning("the promoted version is not used: %r", error)
                continue
            if found is not None:
                self._found.put(found)
