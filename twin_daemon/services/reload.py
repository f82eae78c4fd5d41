"""What a running daemon takes over of a configuration that was changed under it."""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from twin_daemon.errors import TwinError

if TYPE_CHECKING:
    from twin_daemon.daemon.settings import DaemonSettings, TwinConfig

log = logging.getLogger("twin")


class Reloader:
    """Reads the configuration again, hands the keys that can change under way to `retune`, and names the others."""

    def __init__(self, path: Path, running: TwinConfig, retune: Callable[[DaemonSettings], None]) -> None:
        self.running = running
        self._path = path
        self._retune = retune

    def reload(self) -> None:
        """A configuration that is wrong changes nothing."""
        from twin_daemon.daemon.configuration import after_reload, load_config

        try:
            wanted = load_config(self._path, os.environ).config
        except TwinError as error:
            log.error("the configuration is not taken over: %s", error.line())
            return
        self.running, taken, waiting = after_reload(self.running, wanted)
        if taken:
            self._retune(self.running.daemon)
            log.info("taken over: %s", ", ".join(taken))
        if waiting:
            log.warning("needs a restart: %s", ", ".join(waiting))
        if not taken and not waiting:
            log.info("the configuration has not changed")
