"""The check that a test leaves nothing running is itself checked."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LEAKY = """
import asyncio, socket, subprocess, sys, threading

kept = []

def test_that_leaks():
    thread = threading.Thread(target=threading.Event().wait, name="forgotten", daemon=True)
    thread.start()
    listener = socket.create_server(("127.0.0.1", 0))
    loop = asyncio.new_event_loop()
    task = loop.create_task(asyncio.sleep(60), name="unfinished")
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(30)"])
    kept.extend([listener, loop, task, child])

def test_that_cleans_up():
    thread = threading.Thread(target=int)
    thread.start()
    with socket.create_server(("127.0.0.1", 0)):
        thread.join()
    subprocess.run([sys.executable, "-c", "pass"], check=True)
    kept[-1].kill()
    kept[-1].wait()
"""


@pytest.mark.slow
def test_what_a_test_leaves_behind_fails_it_and_not_its_neighbour(tmp_path: Path) -> None:
    (tmp_path / "test_leaky.py").write_text(LEAKY, encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-p", "no:cacheprovider", "-q", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert "2 passed, 1 error" in done.stdout
    line = next(line for line in done.stdout.splitlines() if "Failed: left running" in line)
    assert all(left in line for left in ("thread forgotten", "socket", "asyncio task unfinished", "process"))
