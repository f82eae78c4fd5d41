"""What every test gets: its own state folder, fixed seeds, and a check that it leaves nothing running."""

from __future__ import annotations

import twin_daemon  # noqa: F401 before numpy: it says with how many threads

# isort: split
import asyncio.tasks
import os
import random
import threading
import time
import zlib
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import numpy as np
import psutil
import pytest

from twin_daemon.effects import LIBRARY, reload_files

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
GRACE_S = 3.0  # what a test stopped may need this long to be gone

_KNOWN = frozenset(LIBRARY)  # effects; files that a test leaves in a state folder are no other test's

# Threads that Python did not start (a native library called back) cannot be ended by a test.
# Execnet and pytest-timeout belong to the test runner. Dask unpacks in one thread for as long as the process lives.
_FOREIGN_THREADS = ("Dummy-", "execnet", "pytest_timeout", "pytest-timeout", "Dask-Offload")
# multiprocessing keeps these helpers until its parent ends.
_FOREIGN_PROCESSES = ("multiprocessing.resource_tracker", "multiprocessing.forkserver")

hypothesis.settings.register_profile("default", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "default")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Real processes come first: their files take longest, and no worker ends with one while the others wait."""
    items.sort(key=lambda item: "processes" not in item.path.parts)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of measured recordings beside the checkout; they are not part of the project."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the measured recordings (../shared/data) are not on this machine")
    return SHARED_DATA


@pytest.fixture(scope="session", autouse=True)
def _no_test_touches_the_users_state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """For fixtures that outlive one test; each test then gets a folder of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("STATE_DIRECTORY", raising=False)
        patch.setenv("TWIN_STATE_DIR", str(tmp_path_factory.mktemp("state")))
        yield


@pytest.fixture(autouse=True)
def state_dir(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty state folder; children of the test see it too."""
    folder = tmp_path / "twin-state"
    monkeypatch.setenv("TWIN_STATE_DIR", str(folder))
    monkeypatch.delenv("TWIN_DEBUG", raising=False)
    yield folder
    if set(LIBRARY) != _KNOWN:
        monkeypatch.setenv("TWIN_STATE_DIR", str(tmp_path / "nothing"))
        reload_files()


@pytest.fixture(autouse=True)
def _seeds() -> None:
    random.seed(0)
    np.random.seed(0)  # noqa: NPY002 - for third parties that draw from the global generator


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    """Random numbers that are the same in every run and different in every test."""
    return np.random.default_rng(zlib.crc32(request.node.nodeid.encode()))


@pytest.fixture(autouse=True)
def _nothing_is_left_running() -> Iterator[None]:
    """A test that leaves a thread, an asyncio task, a child process or a network socket behind fails."""
    before = _running()
    yield
    deadline = time.monotonic() + GRACE_S
    while (left := _running() - before) and time.monotonic() < deadline:
        time.sleep(0.02)
    if left:
        pytest.fail("left running: " + "; ".join(sorted(what for what, _ in left)))


def _running() -> set[tuple[str, int]]:
    """What is running in this process, each with something that tells it from its likes."""
    process = psutil.Process()
    found = {
        (f"thread {thread.name}", id(thread))
        for thread in threading.enumerate()
        if not thread.name.startswith(_FOREIGN_THREADS)
    }
    found |= {(f"asyncio task {task.get_name()}", id(task)) for task in _tasks() if not task.done()}
    found |= {
        (f"socket {connection.laddr} -> {connection.raddr or 'nobody'}", connection.fd)
        for connection in process.net_connections("inet")
    }
    found |= {(f"process {child.pid} {' '.join(command)}", child.pid) for child, command in _children(process)}
    return found


def _tasks() -> list[asyncio.Task]:
    # Tasks of every loop, also of one that is not running any more; the registry's name changed in Python 3.12.
    registry = getattr(asyncio.tasks, "_scheduled_tasks", None) or getattr(asyncio.tasks, "_all_tasks", ())
    return list(registry)


def _text(path: Path) -> str:
    """Of a thread; empty where it has ended meanwhile."""
    try:
        return path.read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


def _children(process: psutil.Process) -> Iterator[tuple[psutil.Process, list[str]]]:
    threads = Path("/proc/self/task")
    if threads.is_dir() and not any(_text(own) for own in threads.glob("*/children")):
        return  # where the kernel says so at once, not every process of the machine is looked at
    for child in process.children(recursive=True):
        try:
            command = child.cmdline()
            ended = child.status() == psutil.STATUS_ZOMBIE
        except psutil.NoSuchProcess:
            continue
        if not ended and not any(helper in " ".join(command) for helper in _FOREIGN_PROCESSES):
            yield child, command
