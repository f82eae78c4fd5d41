"""Ctrl-C in a real process: the best so far becomes a version."""

from __future__ import annotations

import json
import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.test_offline import bag
from twin_daemon.resources import twin_command
from twin_daemon.versions import VersionStore

__all__ = ["bag"]


def wait_for_a_best(terminal: int, timeout_s: float = 90.0) -> None:
    """Reads the progress bar until it tells a best error."""
    shown, deadline = "", time.monotonic() + timeout_s
    while "rad" not in shown:
        assert time.monotonic() < deadline, shown
        if select.select([terminal], [], [], 0.2)[0]:
            shown += os.read(terminal, 65536).decode(errors="replace")


def drain(terminal: int, process: subprocess.Popen[str], timeout_s: float = 120.0) -> None:
    """Reads on until the process ends: a terminal that nobody reads holds up whoever draws a bar on it."""
    deadline = time.monotonic() + timeout_s
    while process.poll() is None and time.monotonic() < deadline:
        if select.select([terminal], [], [], 0.1)[0]:
            os.read(terminal, 65536)


@pytest.fixture
def heard() -> Iterator[None]:
    """Ctrl-C reaches the processes that a test starts, also where whoever started the tests ignores it (nohup, &)."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard")
def test_ctrl_c_keeps_the_best_and_stores_it(bag: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.json"
    argv = ["calibrate", "--recording", str(bag), "--search", "random", "--budget", "1000000", "--json", str(report)]
    terminal, end = pty.openpty()
    process = subprocess.Popen(
        twin_command(*argv),
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "TERM": "xterm"},
        stdout=subprocess.PIPE,
        stderr=end,
        text=True,
    )
    try:
        wait_for_a_best(terminal)
        process.send_signal(signal.SIGINT)
        drain(terminal, process)
        out, _ = process.communicate(timeout=60)
    finally:
        if process.poll() is None:
            process.kill()
            process.communicate()
        os.close(end)
        os.close(terminal)
    assert process.returncode == 0
    assert "interrupted: this is the best so far" in out
    fitted = json.loads(report.read_text())
    assert fitted["interrupted"] is True
    assert 0 < fitted["evaluations"] < 1_000_000
    assert fitted["after"]["mse_rad2"] <= fitted["before"]["mse_rad2"]
    store = VersionStore("shadow_hand")
    assert store.get(fitted["version"]).id == fitted["version"]
    # only what held-out motion confirms is for promotion; how far the search came is a matter of luck
    assert (store.aliases().get("candidate") == fitted["version"]) == fitted["candidate"]
