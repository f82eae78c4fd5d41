"""Other `twin` processes that a command starts and always ends again, by their own id."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
from pathlib import Path
from types import TracebackType

from twin_daemon.errors import TwinError
from twin_daemon.resources import twin_command

_PATIENCE_S = 5.0


def free_port() -> int:
    """A port of this machine that nothing listens at now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Children:
    """Starts `twin ...` with an environment of its own; what it says goes to a log file each."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self._folder = folder
        self._environment = {**os.environ, **environment}
        self._running: dict[str, subprocess.Popen[bytes]] = {}

    def start(self, name: str, *arguments: str) -> None:
        """Starts one that works in the background."""
        with self._log(name).open("ab") as log:
            self._running[name] = subprocess.Popen(
                twin_command(*arguments),
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
            )

    def run(self, name: str, *arguments: str) -> None:
        """Runs one to its end. Raises with its last line where it fails."""
        self.start(name, *arguments)
        code = self._running[name].wait()  # stays in the list while it runs: an interrupt ends it too
        del self._running[name]
        if code != 0:
            raise self._failed(name, code)

    def check(self) -> None:
        """Raises where one that should work in the background has ended."""
        for name, process in self._running.items():
            if process.poll() is not None:
                raise self._failed(name, process.returncode)

    def end(self, name: str) -> None:
        """Asks one to end, and makes it end if it does not."""
        process = self._running.pop(name, None)
        if process is None:
            return
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def __enter__(self) -> Children:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for name in list(self._running):
            self.end(name)

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def _failed(self, name: str, code: int) -> TwinError:
        lines = [line for line in self._log(name).read_text(errors="replace").splitlines() if line.strip()]
        last = lines[-1] if lines else "it said nothing"
        return TwinError(f"'twin {name}' ended with {code}: {last}", todo=f"All it said is in {self._log(name)}")
