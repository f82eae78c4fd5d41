"""A real Dask scheduler and real workers on loopback; what needs them says so where Dask is not installed."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from twin_daemon.cli.children import free_port

ROOT = Path(__file__).resolve().parents[2]
START_S = 60.0


class Dask:
    """A scheduler with workers of one thread each. They are killed by their own ids at the end."""

    def __init__(self, folder: Path) -> None:
        self.address = f"tcp://127.0.0.1:{free_port()}"
        self.workers: list[subprocess.Popen[bytes]] = []
        self._folder = folder
        quiet = ("--dashboard-address", "127.0.0.1:0", "--no-jupyter")
        self.scheduler = self._start("scheduler", "Scheduler at:", "--host", self.address, *quiet)

    def add_workers(self, count: int) -> None:
        quiet = ("--nthreads", "1", "--no-nanny", "--no-dashboard")
        for _ in range(count):
            self.workers.append(self._start("worker", "Registered to:", self.address, *quiet))

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()

    def _start(self, what: str, ready: str, *arguments: str) -> subprocess.Popen[bytes]:
        """A process that has said that it is ready."""
        log = self._folder / f"{what}-{len(self.workers)}.log"
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *arguments]
        with log.open("wb") as output:
            process = subprocess.Popen(command, cwd=self._folder, env=environment, stdout=output, stderr=output)
        deadline = time.monotonic() + START_S
        while ready not in log.read_text():
            if process.poll() is not None or time.monotonic() > deadline:
                process.kill()
                process.wait()
                raise AssertionError(log.read_text())
            time.sleep(0.05)
        return process


@pytest.fixture
def dask(tmp_path: Path) -> Iterator[Dask]:
    pytest.importorskip("distributed", reason="Dask (the extra `cluster`) is not installed")
    running = Dask(tmp_path)
    try:
        yield running
    finally:
        running.close()
