"""Long pieces of work side by side, each in a process of its own.

Between roll-outs the interpreter's lock keeps threads from running at once: two of them take a diagnosis hardly further
than one. A process that is forked has all that its work needs without a copy, and only the answer is sent back.
"""

from __future__ import annotations

import ctypes
import multiprocessing
import os
import pickle
import signal
import sys
import threading
from collections.abc import Callable, Generator, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import TypeVar

from twin_daemon.executor import begin_on_one_core, on_this_machine, processor_s, thread_count

_PR_SET_PDEATHSIG = 1  # of prctl(2)

Item = TypeVar("Item")
Result = TypeVar("Result")
Say = Callable[[str], None]
"""Called with a line of what work has come to."""


def places(count: int) -> int:
    """How many processes so many pieces of work get: one a core, or 1 where all is done in this process.

    So it is with one core or one piece, where work is sent to a cluster, in another thread than the main one, and on a
    system that cannot fork while libraries run threads.
    """
    in_main = threading.current_thread() is threading.main_thread()
    forks = on_this_machine() and in_main and sys.platform.startswith("linux")
    return min(thread_count(), count) if forks else 1


def side_by_side(
    work: Callable[[Item, Say], Result], items: Sequence[Item], say: Say
) -> Generator[tuple[int, Result], None, None]:
    """(index, work(item, say)) for each item, as they end. What the work raises is raised here.

    In as many processes as there are `places`. What one of several says is told when it has ended. What a process that
    was killed had begun is done in this one. Whoever stops asking ends the processes.
    """
    count = places(len(items))
    if count < 2:
        for index, item in enumerate(items):
            yield index, work(item, say)
        return
    waiting = list(range(len(items)))[::-1]
    running: dict[Connection, tuple[BaseProcess, int]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < count:
                index = waiting.pop()
                connection, process = _begun(work, items[index], count)
                running[connection] = process, index
            for connection in wait(list(running)):
                assert isinstance(connection, Connection)
                process, index = running.pop(connection)
                try:
                    error, answer, said = pickle.loads(connection.recv_bytes())
                except EOFError:
                    error, answer, said = None, work(items[index], say), ()
                finally:
                    connection.close()
                process.join()
                for line in said:
                    say(line)
                if error is not None:
                    raise error
                yield index, answer
    finally:
        for connection, (process, _) in running.items():
            process.kill()
            process.join()
            connection.close()


def _begun(work: Callable[[Item, Say], Result], item: Item, count: int) -> tuple[Connection, BaseProcess]:
    """The end of a pipe at which the answer of a new process arrives, and that process."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    arguments = (work, item, count, processor_s(), os.getpid(), sender)
    process = multiprocessing.get_context("fork").Process(target=_work, args=arguments, daemon=True)
    process.start()
    sender.close()
    return receiver, process


def _work(
    work: Callable[[Item, Say], Result], item: Item, count: int, spent_s: float, parent: int, sender: Connection
) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever began this process ends it
    _end_with(parent)
    begin_on_one_core(spent_s, count)
    said: list[str] = []
    try:
        answer = (None, work(item, said.append), said)
    except Exception as error:
        answer = (error, None, said)
    sender.send_bytes(pickle.dumps(answer))
    os._exit(0)  # what the first process has not written yet is not written twice


def _end_with(parent: int) -> None:
    """This process is killed when its parent ends, however that one dies: nobody would take its answer."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it had ended before
        os._exit(0)
