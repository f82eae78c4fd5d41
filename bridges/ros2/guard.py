"""An error costs one message, never the bridge."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from typing import Any

log = logging.getLogger("twin.bridge")


class Guard:
    """Wraps callbacks. The first failure of a kind is a warning, its repetitions are only counted."""

    def __init__(self) -> None:
        self.errors = 0
        self._failing: set[str] = set()

    def around(self, what: str, action: Callable[..., Any]) -> Callable[..., None]:
        """`action` as a callback that does not raise; it is called `what` in the log."""

        @wraps(action)
        def guarded(*arguments: Any) -> None:
            try:
                action(*arguments)
            except Exception as error:
                self.failed(what, error)
            else:
                self.worked(what)

        return guarded

    def failed(self, what: str, error: Exception) -> None:
        self.errors += 1
        level = logging.DEBUG if what in self._failing else logging.WARNING
        self._failing.add(what)
        log.log(level, "%s failed and is skipped: %r", what, error)

    def worked(self, what: str) -> None:
        self._failing.discard(what)
