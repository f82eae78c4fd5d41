"""Real processes of the command line on a free port, ended by their own id."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from twin_daemon.cli.children import free_port
from twin_daemon.resources import twin_command

# Times of a gate on a machine that does something else beside: tests are about what happens, not about when.
SLOW_MACHINE = {"heartbeat_s": 2.0, "state_timeout_s": 2.0, "command_age_s": 30.0}


class Twin:
    """Starts `twin ...` on one endpoint of its own; everything still running is killed at the end."""

    def __init__(self, folder: Path) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self._folder = folder
        self._environment = {**os.environ, "TWIN_ENDPOINT": self.endpoint, "PYTHONPATH": os.pathsep.join(sys.path)}
        self._running: list[subprocess.Popen[str]] = []

    def start(self, *arguments: str, who: str | None = None) -> subprocess.Popen[str]:
        """Starts `twin ARGUMENTS`, in the name of an identity of the key file."""
        process = subprocess.Popen(
            twin_command(*arguments),
            cwd=self._folder,
            env=self._environment | ({} if who is None else {"TWIN_AS": who}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._running.append(process)
        return process

    def end(self, process: subprocess.Popen[str], timeout_s: float = 10.0) -> tuple[int, str, str]:
        """SIGTERM if it still runs; exit code and both outputs."""
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        out, err = process.communicate(timeout=timeout_s)
        return process.returncode, out, err

    def finish(self, process: subprocess.Popen[str], timeout_s: float = 40.0) -> tuple[int, str, str]:
        """Waits until it ends by itself."""
        out, err = process.communicate(timeout=timeout_s)
        return process.returncode, out, err

    def run(self, *arguments: str, who: str | None = None) -> tuple[int, str, str]:
        return self.finish(self.start(*arguments, who=who))

    def query(self, question: str, timeout_s: float = 15.0, who: str | None = None) -> dict[str, Any]:
        code, out, err = self.run("query", question, "--timeout", str(timeout_s), "--json", "-", who=who)
        assert code == 0, err
        return json.loads(out)

    def __enter__(self) -> Twin:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._running:
            if process.poll() is None:
                process.kill()
            process.communicate()


@pytest.fixture
def twin(tmp_path: Path) -> Iterator[Twin]:
    with Twin(tmp_path) as processes:
        yield processes


def until(condition: Any, timeout_s: float = 60.0) -> Any:
    """The first true value of `condition`."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        found = condition()
        if found:
            return found
        time.sleep(0.05)
    pytest.fail(f"not within {timeout_s:g} s")


@pytest.fixture(name="until")
def _until() -> Any:
    return until
