"""Work in several processes of this machine.

Between roll-outs the interpreter's lock keeps threads from running at once: two of them take a diagnosis hardly further
than one. A process that is forked has all that its work needs without a copy, and only the answer is sent back.
"""

from __future__ import annotations

import ctypes
import functools
import gc
import io
import multiprocessing
import os
import pickle
import signal
import struct
from collections.abc import Callable, Generator, Mapping, Sequence
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from twin_daemon.processor_time import begin_on_one_core, processor_s

_PR_SET_PDEATHSIG = 1  # of prctl(2)
_MEANWHILE_S = 0.25  # between looks of a person at a progress bar
_INDEX = struct.Struct("i")
_MARK = "__never_changes__"

Item = TypeVar("Item")
Result = TypeVar("Result")
Say = Callable[[str], None]
"""Called with a line of what work has come to."""


def in_processes(
    work: Callable[[Item, Say], Result],
    items: Sequence[Item],
    say: Say,
    count: int,
    meanwhile: Callable[[], None] = lambda: None,
) -> Generator[tuple[int, Result], None, None]:
    """(index, work(item, say)) for each item, as they end, in `count` processes that take one after another.

    What the work raises is raised here. What it says is told when it has ended; `meanwhile` is called now and then
    until all have. What a process that was killed had begun is done in this one. Whoever stops asking ends the
    processes.

    What never changes and was here before comes back as what it was: see `never_changes`.
    """
    known = _known()
    asked, end = os.pipe()
    left = set(range(len(items)))
    os.write(end, b"".join(map(_INDEX.pack, range(len(items)))))
    os.close(end)
    running: dict[Connection, BaseProcess] = {}
    try:
        for _ in range(count):
            connection, process = _begun(work, items, count, asked, known)
            running[connection] = process
        while running:
            ended = wait(list(running), _MEANWHILE_S)
            meanwhile()
            for connection in ended:
                assert isinstance(connection, Connection)
                try:
                    index, error, answer, said = _Receiver(connection.recv_bytes(), known).load()
                except EOFError:
                    running.pop(connection).join()
                    connection.close()
                    continue
                left.discard(index)
                for line in said:
                    say(line)
                if error is not None:
                    raise error
                yield index, answer
    finally:
        os.close(asked)
        for connection, process in running.items():
            process.kill()
            process.join()
            connection.close()
    for index in sorted(left):
        yield index, work(items[index], say)


def never_changes(kind: type[Item]) -> type[Item]:
    """Marks a class whose instances are not changed once they are made, as those of a frozen dataclass are not.

    A process that was forked has the same ones: they are sent back as references, and what a process has kept in them
    for later is lost. One with an attribute `made_by`, (function, arguments), is made by that where it arrives.
    """
    setattr(kind, _MARK, True)
    return kind


@functools.cache
def _is_reference(kind: type[Any]) -> bool:
    if not str(kind.__module__).startswith("twin_daemon."):
        return False
    frozen = getattr(kind, "__dataclass_params__", None)
    return bool(getattr(kind, _MARK, False) or (frozen and frozen.frozen))


def _known() -> dict[int, Any]:
    """What may be sent back as a reference, by its id, which it keeps in a process that is forked."""
    return {id(one): one for one in gc.get_objects() if _is_reference(type(one))}


class _Sender(pickle.Pickler):
    def __init__(self, file: io.BytesIO, known: Mapping[int, Any]) -> None:
        super().__init__(file, protocol=pickle.HIGHEST_PROTOCOL)
        self._known = known

    def persistent_id(self, obj: Any) -> int | None:
        return id(obj) if id(obj) in self._known else None

    def reducer_override(self, obj: Any) -> Any:
        return getattr(obj, "made_by", None) or NotImplemented


class _Receiver(pickle.Unpickler):
    def __init__(self, message: bytes, known: Mapping[int, Any]) -> None:
        super().__init__(io.BytesIO(message))
        self._known = known

    def persistent_load(self, pid: int) -> Any:
        return self._known[pid]


def _begun(
    work: Callable[[Item, Say], Result], items: Sequence[Item], count: int, asked: int, known: Mapping[int, Any]
) -> tuple[Connection, BaseProcess]:
    """The end of a pipe at which the answers of a new process arrive, and that process."""
    receiver, sender = multiprocessing.Pipe(duplex=False)
    arguments = (work, items, count, processor_s(), os.getpid(), asked, sender, known)
    process = multiprocessing.get_context("fork").Process(target=_work, args=arguments, daemon=True)
    collects = gc.isenabled()
    gc.disable()  # until the new process has set aside what is not its own
    try:
        process.start()
    finally:
        if collects:
            gc.enable()
    sender.close()
    return receiver, process


def _work(
    work: Callable[[Item, Say], Result],
    items: Sequence[Item],
    count: int,
    spent_s: float,
    parent: int,
    asked: int,
    sender: Connection,
    known: Mapping[int, Any],
) -> None:
    # What the first process has thrown away is for that one to finish: a session or a pool of threads, closed here,
    # would wait for threads that no fork brings along.
    gc.freeze()
    gc.enable()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever began this process ends it
    _end_with(parent)
    begin_on_one_core(spent_s, count)
    while taken := os.read(asked, _INDEX.size):
        (index,) = _INDEX.unpack(taken)
        said: list[str] = []
        try:
            message = _packed((index, None, work(items[index], said.append), said), known)
        except Exception as error:
            message = _packed((index, error, None, said), known)
        sender.send_bytes(message)
    sender.close()
    os._exit(0)  # what the first process has not written yet is not written twice


def _packed(answer: tuple[int, Exception | None, Any, list[str]], known: Mapping[int, Any]) -> bytes:
    message = io.BytesIO()
    _Sender(message, known).dump(answer)
    return message.getvalue()


def _end_with(parent: int) -> None:
    """This process is killed when its parent ends, however that one dies: nobody would take its answer."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it had ended before
        os._exit(0)
