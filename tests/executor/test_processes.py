"""Work side by side in processes: the same answers as one after another, and nothing is left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from twin_daemon.errors import BadInput
from twin_daemon.executor import side_by_side
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit, thread_count

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are forked on Linux alone")
HERE = os.getpid()


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWIN_THREADS", "2")


def _children() -> list[str]:
    return Path(f"/proc/{os.getpid()}/task/{threading.get_native_id()}/children").read_text(encoding="ascii").split()


def test_each_has_its_answer_and_a_process_with_one_core() -> None:
    found = dict(side_by_side(lambda n, _: (n * n, os.getpid(), thread_count()), range(5), print))
    assert [found[i][0] for i in range(5)] == [0, 1, 4, 9, 16]
    assert len({pid for _, pid, _ in found.values()} - {HERE}) == 5
    assert {threads for _, _, threads in found.values()} == {1}


def test_one_core_one_item_or_another_thread_stays_in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    def pids(count: int) -> set[int]:
        return {pid for _, pid in side_by_side(lambda *_: os.getpid(), range(count), print)}

    assert pids(1) == {HERE}
    told: list[set[int]] = []
    thread = threading.Thread(target=lambda: told.append(pids(3)))
    thread.start()
    thread.join()
    assert told == [{HERE}]
    monkeypatch.setenv("TWIN_THREADS", "1")
    assert pids(3) == {HERE}


def test_what_each_says_is_told_together_when_it_has_ended() -> None:
    def work(n: int, say: Say) -> int:
        say(f"{n} begins")
        time.sleep(0.2)
        say(f"{n} ends")
        return n

    told: list[str] = []
    for _, n in side_by_side(work, range(3), told.append):
        assert told[-2:] == [f"{n} begins", f"{n} ends"]
    assert len(told) == 6


def test_what_fails_is_raised_here_and_the_others_end() -> None:
    def work(n: int, _: Say) -> None:
        if n == 0:
            raise BadInput("no good", where="item 0", todo="Take another")
        time.sleep(60.0)

    before = set(_children())
    with pytest.raises(BadInput, match="item 0: no good"):
        list(side_by_side(work, range(2), print))
    assert not set(_children()) - before


def test_whoever_stops_asking_ends_them() -> None:
    before = set(_children())
    answers = side_by_side(lambda n, _: time.sleep(60.0 * n), range(2), print)
    assert next(answers) == (0, None)
    assert len(set(_children()) - before) == 1
    answers.close()
    assert not set(_children()) - before


def test_what_a_killed_process_had_begun_is_done_here() -> None:
    def work(n: int, _: Say) -> int:
        if n == 1 and os.getpid() != HERE:
            os.kill(os.getpid(), signal.SIGKILL)
        return os.getpid()

    found = dict(side_by_side(work, range(3), print))
    assert found[1] == HERE
    assert HERE not in (found[0], found[2])


def test_ctrl_c_is_for_the_first_process() -> None:
    def work(n: int, _: Say) -> int:
        os.kill(os.getpid(), signal.SIGINT)
        return n

    assert dict(side_by_side(work, range(2), print)) == {0: 0, 1: 1}


def test_a_time_limit_counts_what_the_processes_do() -> None:
    def until_over(_: int, __: Say) -> bool:
        return _spend(30.0)

    def _spend(at_most_s: float) -> bool:
        end = time.monotonic() + at_most_s
        while time.monotonic() < end:
            if limit.over():
                return True
        return False

    limit = TimeLimit(0.5)  # of two cores: a second in all, which two processes share
    assert dict(side_by_side(until_over, range(2), print)) == {0: True, 1: True}
    assert limit.over()
    assert not TimeLimit(0.5).over()


_BEGIN_AND_SAY = """
import os, time
from twin_daemon.executor import side_by_side
def work(n, say):
    os.write(1, b"begun\\n")
    time.sleep(60.0)
list(side_by_side(work, range(2), print))
"""


def test_they_end_with_the_first_process_however_that_one_dies() -> None:
    first = subprocess.Popen([sys.executable, "-c", _BEGIN_AND_SAY], stdout=subprocess.PIPE, text=True)
    assert first.stdout is not None
    try:
        assert [first.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
    finally:
        first.kill()
    first.communicate(timeout=10.0)  # until all have closed their end of the pipe: they would sleep for a minute
