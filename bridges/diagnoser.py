"""A diagnosis of the last minutes, in a process of its own, when somebody asks for it."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import psutil

from bridges.keep import Keeper
from twin_daemon.daemon import reports
from twin_daemon.daemon.service import TwinService

log = logging.getLogger(__name__)

_TWIN = "import sys; from twin_daemon.cli.app import main; sys.exit(main())"
_LOWEST_PRIORITY = 19
_CLOSE_S = 5.0


class Diagnoser:
    """Keeps the ring as a recording and lets `twin diagnose` read it, at the lowest priority; one at a time.

    `arguments` name the hand for the command line. `poll` has to be called now and then: it notices the end, which
    becomes an event.
    """

    def __init__(self, keeper: Keeper, service: TwinService, arguments: Sequence[str]) -> None:
        self._keeper, self._service = keeper, service
        self._arguments = list(arguments)
        self._process: subprocess.Popen[str] | None = None
        self._result_path: Path | None = None
        self._recording: str | None = None
        self._last: dict[str, Any] | None = None
        self._lock = threading.Lock()

    def start(self, _key: str = "") -> dict[str, Any]:
        """Begins a diagnosis, or says why not."""
        with self._lock:
            if self._process is not None:
                return self._answer(accepted=False, reason="a diagnosis is running; ask for `diagnosis`")
            kept = self._keeper.keep()
            if not kept["kept"]:
                return self._answer(accepted=False, reason=kept["why"])
            recording = Path(kept["path"])
            self._recording, self._result_path = str(recording), recording.with_suffix(".diagnosis.json")
            command = [
                sys.executable, "-c", _TWIN, "diagnose", "--recording", str(recording), *self._arguments,
                "--version", str(self._service.version_info["id"]), "--json", str(self._result_path),
            ]  # fmt: skip
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
            psutil.Process(self._process.pid).nice(_LOWEST_PRIORITY)
        return self._answer(accepted=True, reason=f"diagnosing the last {kept['seconds']:.0f} s")

    def latest(self, _key: str = "") -> dict[str, Any]:
        """The last diagnosis that ended, and whether another one runs."""
        return self._answer(result=self._last)

    def poll(self) -> None:
        """Takes up the result of a diagnosis that has ended."""
        process = self._process
        if process is None or process.poll() is None:
            return
        _, said = process.communicate()
        self._last = self._read(process.returncode, said)
        self._process = None
        if "verdict" in self._last:
            names = ", ".join(f"{f['effect']} at {' '.join(f['joints'])}" for f in self._last["findings"])
            text = f"diagnosis of the last minutes: {self._last['verdict']}" + (f", {names}" if names else "")
        else:
            text = f"the diagnosis failed: {self._last['error']}"
        self._service.tell("diagnosis", text, {"recording": self._recording, "result": str(self._result_path)})

    def close(self) -> None:
        """Ends a diagnosis that still runs."""
        process, self._process = self._process, None
        if process is None:
            return
        process.terminate()
        try:
            process.communicate(timeout=_CLOSE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()

    def _read(self, code: int, said: str) -> dict[str, Any]:
        if code == 0 and self._result_path is not None:
            try:
                return json.loads(self._result_path.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                return {"error": str(error)}
        lines = said.strip().splitlines()
        return {"error": lines[-1][:500] if lines else f"exit code {code}"}

    def _answer(self, **rest: Any) -> dict[str, Any]:
        return reports.header(self._service) | {
            "running": self._process is not None,
            "recording": self._recording,
            **rest,
        }
