"""Another `twin` process beside the daemon's loop, at a low priority, whose JSON is read when it has ended."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

from twin_daemon.resources import step_back, twin_command

_END_S = 5.0
_MOST_SAID = 500


class Child:
    """Runs `twin ARGUMENTS --json RESULT` until it ends or is ended. One that left no result says why in `error`."""

    def __init__(self, *arguments: str, result: Path, nice: int) -> None:
        self.result = result
        result.unlink(missing_ok=True)
        self._process = subprocess.Popen(
            twin_command(*arguments, "--json", str(result)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
        )
        step_back(self._process.pid, nice)

    @property
    def running(self) -> bool:
        return self._process.poll() is None

    def outcome(self) -> dict[str, Any]:
        """What it wrote, or {"error": its last line}. Waits for its end."""
        _, said = self._process.communicate()
        try:
            return json.loads(self.result.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            lines = said.strip().splitlines()
            return {"error": lines[-1][:_MOST_SAID] if lines else f"exit code {self._process.returncode}"}

    def end(self) -> None:
        """Asks it to end, and makes it end if it does not."""
        self._process.terminate()
        try:
            self._process.communicate(timeout=_END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.communicate()
