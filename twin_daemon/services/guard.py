"""An error costs one message, never the loop."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import wraps
from typing import Any


class Guard:
    """Runs what may fail. The first failure of a kind is a warning, its repetitions are only counted."""

    def __init__(self, log: logging.Logger) -> None:
        self.errors = 0
        self._log = log
        self._failing: set[str] = set()

    def run(self, what: str, action: Callable[..., Any], *arguments: Any) -> None:
        """Calls `action`, which may raise; it is called `what` in the log."""
        try:
            action(*arguments)
        except Exception as error:
            self.failed(what, error)
        else:
            self._failing.discard(what)

    def around(self, what: str, action: Callable[..., Any]) -> Callable[..., None]:
        """`action` as a callback that does not raise."""

        @wraps(action)
        def guarded(*arguments: Any) -> None:
            self.run(what, action, *arguments)

        return guarded

    def failed(self, what: str, error: Exception) -> None:
        """Counts a failure that was caught elsewhere."""
        self.errors += 1
        level = logging.DEBUG if what in self._failing else logging.WARNING
        self._failing.add(what)
        self._log.log(level, "%s failed and is skipped: %r", what, error)
