"""Work side by side in processes: the same answers as one after another, and nothing is left behind."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import weakref
from pathlib import Path

import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.executor import side_by_side
from twin_daemon.hand.description import load_hand
from twin_daemon.processes import Say
from twin_daemon.processor_time import TimeLimit, thread_count
from twin_daemon.simulation.prescribed import Motion
from twin_daemon.simulation.submodel import Part, parts, submodel
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="processes are forked on Linux alone")
HERE = os.getpid()


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TWIN_THREADS", "2")


def _children() -> list[str]:
    return Path(f"/proc/{os.getpid()}/task/{threading.get_native_id()}/children").read_text(encoding="ascii").split()


def test_each_has_its_answer_and_its_process_one_core() -> None:
    def work(n: int, _: Say) -> tuple[int, int, int]:
        time.sleep(0.2)
        return n * n, os.getpid(), thread_count()

    found = dict(side_by_side(work, range(5), print))
    assert [found[i][0] for i in range(5)] == [0, 1, 4, 9, 16]
    assert len({pid for _, pid, _ in found.values()} - {HERE}) == 2
    assert {threads for _, _, threads in found.values()} == {1}


class _Changing:
    def __init__(self) -> None:
        self.values = np.arange(3.0)


def test_what_never_changes_comes_back_as_what_it_was_and_all_else_as_it_has_become() -> None:
    fixed, changing = Motion(*np.zeros((4, 3))), _Changing()

    def work(n: int, _: Say) -> tuple[Motion, Motion, _Changing]:
        changing.values[0] = n
        return fixed, Motion(*np.full((4, 3), float(n))), changing

    found = dict(side_by_side(work, [5, 6], print))
    assert all(one[0] is fixed for one in found.values())
    assert [found[i][1].time_s[0] for i in range(2)] == [5.0, 6.0]
    assert [found[i][2].values[0] for i in range(2)] == [5.0, 6.0]
    assert changing.values[0] == 0.0


def test_a_twin_made_in_a_process_is_the_same_bit_by_bit() -> None:
    twin = TwinModel.load(load_hand())
    usual = np.full(len(twin.joints), 0.1)

    def work(part: Part, _: Say) -> TwinModel:
        small = submodel(twin, part.joints, usual).at_step(0.0007).with_softer_ends(1.1)
        return small.changed(Terms(parameters={f"{small.joints[0]}.damping": 0.01}))

    cut = parts(twin)[:3]
    for index, found in side_by_side(work, cut, print):
        here = work(cut[index], print)
        for field in (
            "body_quat",
            "body_inertia",
            "body_invweight0",
            "dof_damping",
            "dof_invweight0",
            "jnt_axis",
            "jnt_solref",
        ):
            assert np.array_equal(getattr(found.model, field), getattr(here.model, field)), field
        assert found.terms == here.terms
        assert found.model.opt.timestep == 0.0007


def test_a_chain_of_changes_keeps_the_first_twin_alone() -> None:
    twin = TwinModel.load(load_hand())
    between = twin.changed(Terms(parameters={f"{twin.joints[0]}.damping": 0.01}))
    last, gone = between.changed(Terms(parameters={f"{twin.joints[0]}.damping": 0.02})), weakref.ref(between)
    del between
    gc.collect()
    assert gone() is None
    ((_, there),) = [one for one in side_by_side(lambda *_: last.changed(last.terms), range(2), print) if one[0] == 0]
    assert there.terms == last.terms


def test_what_was_thrown_away_before_is_finished_by_the_process_that_had_it(tmp_path: Path) -> None:
    """A session or a pool of threads that is closed in a fork waits for threads which are not there."""
    finished = tmp_path / "by"

    class Session:
        def __init__(self) -> None:
            self.itself = self  # only the collector of cycles finds it

        def __del__(self) -> None:
            with finished.open("a", encoding="ascii") as file:
                file.write(f"{os.getpid()}\n")

    def work(n: int, _: Say) -> int:
        own = Session()
        del own
        gc.collect()
        return os.getpid()

    gc.disable()
    try:
        Session()
        others = {pid for _, pid in side_by_side(work, range(2), print)}
        assert not gc.isenabled()
    finally:
        gc.enable()
    gc.collect()
    by = [int(line) for line in finished.read_text(encoding="ascii").split()]
    assert len(by) == 3  # one of each piece of work, and the one of this process
    assert by.count(os.getpid()) == 1
    assert set(by) == {*others, os.getpid()}


def test_an_answer_that_cannot_be_sent_is_an_error() -> None:
    with pytest.raises((AttributeError, pickle.PicklingError)):
        list(side_by_side(lambda *_: lambda: 0, range(2), print))


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
    assert set(_children()) - before
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
