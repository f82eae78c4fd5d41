"""The latch of a stop, on disk: a gate that was stopped is stopped in its next life, too.

The file is there while the gate is latched, and no longer. One that cannot be read means latched.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from twin_daemon.files import leftovers, make_folder, sync_folder, write_atomically

_MOST_BYTES = 10_000


class Latch:
    """One file. `why` is what it held when it was opened, None where there was none. Safe in several threads."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self.why = self._read()
        self._set = self.why is not None

    def _read(self) -> str | None:
        try:
            content = self._path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            return f"{self._path} cannot be read: {error.strerror}; what it says is taken as a stop"
        try:
            why = json.loads(content[:_MOST_BYTES])["why"]
        except (ValueError, KeyError, TypeError, RecursionError):
            return f"{self._path} is damaged; what it says is taken as a stop"
        return str(why)[:_MOST_BYTES]

    def set(self, why: str, still_wanted: Callable[[], bool] = lambda: True) -> None:
        """Returns when the latch is on disk. `still_wanted` is asked once nobody else changes it. Raises OSError."""
        with self._lock:
            if self._set or not still_wanted():
                return
            make_folder(self._path.parent)
            told = {"schema": 1, "why": why, "stamp_ns": time.time_ns()}
            write_atomically(self._path, json.dumps(told).encode(), mode=0o640)
            self._set = True

    def clear(self) -> None:
        """Returns when the latch is gone from the disk. Raises OSError; it then stays, or may come back."""
        with self._lock:
            self._path.unlink(missing_ok=True)
            for torn in leftovers(self._path):
                torn.unlink(missing_ok=True)
            if self._path.parent.is_dir():
                sync_folder(self._path.parent)
            self._set = False


def kept_on_disk(latch: Latch | None, why: str | None, still_wanted: Callable[[], bool]) -> dict[str, Any]:
    """Puts a stop on disk, and says whether that worked."""
    if latch is None:
        return {"latch_kept": False, "latch_why": "this gate keeps no latch on disk"}
    try:
        latch.set(why or "stopped", still_wanted)
    except OSError as error:
        lost = f"the latch cannot be written ({error.strerror}): it ends with this process"
        return {"latch_kept": False, "latch_why": lost}
    return {"latch_kept": True, "latch_why": None}
