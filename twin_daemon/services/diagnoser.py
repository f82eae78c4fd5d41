"""A diagnosis of the last minutes, in a process of its own, when somebody asks for it."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from twin_daemon.daemon import reports
from twin_daemon.daemon.service import TwinService
from twin_daemon.services.child import Child
from twin_daemon.services.ring_saver import RingSaver

_LOWEST_PRIORITY = 19


class Diagnoser:
    """Keeps the ring as a recording and lets `twin diagnose` read it, at the lowest priority; one at a time.

    `arguments` name the hand for the command line. `poll` has to be called now and then: it notices the end, which
    becomes an event.
    """

    def __init__(self, saver: RingSaver, service: TwinService, arguments: Sequence[str]) -> None:
        self._saver, self._service = saver, service
        self._arguments = list(arguments)
        self._child: Child | None = None
        self._recording: str | None = None
        self._last: dict[str, Any] | None = None
        self._lock = threading.Lock()

    def start(self, _key: str = "") -> dict[str, Any]:
        """Begins a diagnosis, or says why not."""
        with self._lock:
            if self._child is not None:
                return self._answer(accepted=False, reason="a diagnosis is running; ask for `diagnosis`")
            kept = self._saver.save()
            if not kept["kept"]:
                return self._answer(accepted=False, reason=kept["why"])
            recording = Path(kept["path"])
            self._recording = str(recording)
            version = str(self._service.version_info["id"])
            arguments = ["diagnose", "--recording", self._recording, *self._arguments, "--version", version]
            result = recording.with_suffix(".diagnosis.json")
            self._child = Child(*arguments, result=result, nice=_LOWEST_PRIORITY)
        return self._answer(accepted=True, reason=f"diagnosing the last {kept['seconds']:.0f} s")

    def latest(self, _key: str = "") -> dict[str, Any]:
        """The last diagnosis that ended, and whether another one runs."""
        return self._answer(result=self._last)

    def poll(self) -> None:
        """Takes up the result of a diagnosis that has ended."""
        child = self._child
        if child is None or child.running:
            return
        self._last = child.outcome()
        self._child = None
        if "verdict" in self._last:
            names = ", ".join(f"{f['effect']} at {' '.join(f['joints'])}" for f in self._last["findings"])
            text = f"diagnosis of the last minutes: {self._last['verdict']}" + (f", {names}" if names else "")
        else:
            text = f"the diagnosis failed: {self._last['error']}"
        self._service.tell("diagnosis", text, {"recording": self._recording, "result": str(child.result)})

    def close(self) -> None:
        """Ends a diagnosis that still runs."""
        child, self._child = self._child, None
        if child is not None:
            child.end()

    def _answer(self, **rest: Any) -> dict[str, Any]:
        return reports.header(self._service) | {
            "running": self._child is not None,
            "recording": self._recording,
            **rest,
        }
