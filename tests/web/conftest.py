"""A workbench in a process of its own, asked over real sockets, with and without a browser."""

from __future__ import annotations

import json
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes.conftest import Twin
from tests.web.browser import Browser, chromium


class Workbench:
    """The server's address and token, and requests to it."""

    def __init__(self, twin: Twin, *arguments: str) -> None:
        self.twin = twin
        self.process = twin.start("workbench", "--port", "0", *arguments)
        assert self.process.stdout is not None
        said = [self.process.stdout.readline() for _ in range(3)]
        assert said[2], self.process.stderr and self.process.stderr.read()
        self.address = said[1].split()[-1].rstrip("/")
        self.page = said[2].split()[-1]
        self.token = self.page.partition("#token=")[2]
        # what else it says must not fill its pipe
        self._reader = threading.Thread(target=self.process.stdout.read, daemon=True)
        self._reader.start()

    @property
    def host(self) -> str:
        return self.address.removeprefix("http://")

    def ask(
        self, path: str, body: dict[str, Any] | None = None, *, token: bool = True, **headers: str
    ) -> tuple[int, Any]:
        """(status, JSON or text) of a GET, or of a POST where there is a body."""
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(self.address + path, data, {"Content-Type": "application/json"})
        if body is not None and token:
            request.add_header("X-Twin-Token", self.token)
        for name, value in headers.items():
            request.add_header(name.replace("_", "-"), value)
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                status, content = answer.status, answer.read()
        except urllib.error.HTTPError as error:
            with error:
                status, content = error.code, error.read()
        text = content.decode()
        return status, json.loads(text) if text.startswith(("{", "[")) else text

    def end(self) -> int:
        """The exit code after a SIGTERM."""
        if self.process.poll() is None:
            self.process.terminate()
        code = self.process.wait(20)
        self._reader.join(5)
        return code


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workbench]:
    """One without a daemon, for all tests of a module."""
    with Twin(tmp_path_factory.mktemp("served")) as processes:
        running = Workbench(processes, "--name", "twin.lab")
        yield running
        assert running.end() == 0


@pytest.fixture
def processes(tmp_path: Path) -> Iterator[Twin]:
    with Twin(tmp_path) as started:
        yield started


@pytest.fixture
def workbench(processes: Twin) -> Iterator[Any]:
    """Starts workbenches; ends them."""
    running: list[Workbench] = []

    def start(*arguments: str) -> Workbench:
        running.append(Workbench(processes, *arguments))
        return running[-1]

    yield start
    for one in running:
        one.end()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    program = chromium()
    if program is None:
        pytest.skip("no Chromium on this machine (Debian: apt install chromium)")
    with Browser(program, tmp_path / "browser") as running:
        yield running
