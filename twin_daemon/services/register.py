"""What the gate decides, kept for the record and told to whoever listens."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass
from queue import Empty, SimpleQueue
from typing import Any

from twin_daemon.gate.audit import AuditLog

Tell = Callable[[str, str, dict[str, Any]], None]
_REPEAT_S, _LONGEST_REPEAT_S = 1.0, 60.0


class Register:
    """What the gate decides, in the audit log and as events. What repeats without effect, refusals and stops of a gate
    that is stopped already, is written seldom: the second time after a second, then after two, up to once a minute."""

    def __init__(self, audit: AuditLog, tell: Tell) -> None:
        self._audit = audit
        self._tell = tell
        self._repeated: dict[tuple[Any, ...], _Repeated] = {}
        self._untold: SimpleQueue[dict[str, Any]] = SimpleQueue()
        self._unsynced = False

    def __call__(self, entry: dict[str, Any]) -> None:
        """Writes one decision. Raises OSError where the log cannot be written."""
        if not entry["accepted"] or entry.get("again"):
            same = (entry["who"], entry["verb"], entry["check"])
            known, now_s = self._repeated.get(same), time.monotonic()
            if known is not None and now_s < known.next_s:
                known.unwritten += 1
                return
            if len(self._repeated) > 1000:  # names are free to invent
                self._repeated.clear()
            wait_s = _REPEAT_S
            if known is not None and now_s < known.next_s + _LONGEST_REPEAT_S:
                wait_s = min(2.0 * known.wait_s, _LONGEST_REPEAT_S)
                entry = entry | {"repeated": known.unwritten or None}
            self._repeated[same] = _Repeated(now_s + wait_s, wait_s)
        self._audit.write(time.time_ns(), {key: value for key, value in entry.items() if value is not None})
        self._unsynced = True
        # telling may wait for whoever waits for the gate: it is left for later
        self._untold.put(entry)

    def tell(self) -> None:
        """Makes events of what was written since the last call."""
        with contextlib.suppress(Empty):
            while True:
                entry = self._untold.get_nowait()
                data = {key: entry.get(key) for key in ("verb", "who", "accepted", "check")}
                self._tell("gate", _sentence(entry), data)

    def sync(self) -> None:
        """Makes what was written survive a loss of power."""
        if self._unsynced:
            self._unsynced = False
            self._audit.sync()


@dataclass
class _Repeated:
    next_s: float
    wait_s: float
    unwritten: int = 0


def _sentence(entry: dict[str, Any]) -> str:
    who, verb = entry["who"] or "somebody unknown", entry["verb"]
    if verb == "stopped":
        return str(entry["why"])
    if verb == "trip":  # a protective stop
        return f"the motion of {who} has ended: {entry['why']}"
    said = f"{who}: {verb}"
    if entry.get("reason"):
        said += f" ({entry['reason']})"
    return said if entry["accepted"] else f"{said} refused: {entry['why']}"
