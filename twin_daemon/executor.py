"""Where independent work runs: on this machine's cores, or on a Dask cluster for as long as a command asks for it.

Work is the same on both, and so are its results, bit by bit on processors of one kind. A task that a worker takes
with it when it dies is run again by another one; this is Dask's own doing.
"""

from __future__ import annotations

import contextlib
import itertools
import socket
import sys
import threading
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ThreadPoolExecutor
from contextvars import ContextVar, copy_context
from typing import Any, Protocol, TypeVar

import numpy as np

from twin_daemon.errors import BadInput, NoAnswer, UsageError
from twin_daemon.processes import Say, in_processes
from twin_daemon.processor_time import check_time, thread_count

Item = TypeVar("Item")
Result = TypeVar("Result")

_ANSWER_S = 10.0
_LOOK_S = 5.0  # between looks at whether any worker is left
_WAIT_S = 60.0  # for a worker, where none is left


class Executor(Protocol):
    """Runs independent work. Results do not depend on how many places there are."""

    def each(self, work: Callable[[Item], Result], items: list[Item]) -> list[Result]:
        """[work(item) for item in items], in order."""
        ...

    def pieces(self, work: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
        """work(rows), for work that treats each row alone."""
        ...


class Cores:
    """This machine's cores: processes of their own where one can be forked, else threads.

    Roll-outs leave the interpreter's lock; all between them does not, and is as much.
    """

    def each(self, work: Callable[[Item], Result], items: list[Item]) -> list[Result]:
        if (count := _processes(len(items))) > 1:
            found = dict(in_processes(lambda item, _: work(item), items, lambda _: None, count))
            return [found[index] for index in range(len(items))]
        with ThreadPoolExecutor(max_workers=thread_count()) as pool:
            waiting = [pool.submit(copy_context().run, work, item) for item in items]
            try:
                return [future.result() for future in waiting]
            except BaseException:
                for future in waiting:
                    future.cancel()
                raise

    def pieces(self, work: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
        return work(rows)  # roll-outs use all cores themselves


class Cluster:
    """The workers of a Dask cluster. What is sent to them is pickled, so that whoever is on it can run code."""

    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._work: tuple[Any, Any] = (None, None)

    def each(self, work: Callable[[Item], Result], items: list[Item]) -> list[Result]:
        import cloudpickle
        from distributed.comm.core import CommClosedError
        from distributed.scheduler import KilledWorker

        tasks: list[Any] = []
        try:
            # as a task, not as data on one worker: what dies with that worker is made again
            if self._work[0] != work:
                self._work = (work, self._client.submit(_unpacked, cloudpickle.dumps(work), pure=False))
            # dealt out in turn: left to itself Dask would keep short tasks where the work has been unpacked
            for item, place in zip(items, itertools.cycle(self._workers() or [None]), strict=False):
                free = {"workers": place, "allow_other_workers": place is not None}
                tasks.append(self._client.submit(_applied, self._work[1], cloudpickle.dumps(item), pure=False, **free))
            self._await(tasks)
            return [cloudpickle.loads(found) for found in self._client.gather(tasks)]
        except KilledWorker as error:
            raise NoAnswer(f"a task took worker after worker with it: {error}", where=self._address) from None
        except (CancelledError, CommClosedError):
            raise NoAnswer(
                "the scheduler has gone", where=self._address, todo="Start it again, and the command"
            ) from None
        finally:
            self._client.cancel(tasks)

    def _await(self, tasks: list[Any]) -> None:
        """Until all tasks have ended. Raises NoAnswer where no worker is left for a minute."""
        from distributed import wait

        alone_s = 0.0
        while alone_s < _WAIT_S:
            with contextlib.suppress(TimeoutError):
                wait(tasks, timeout=_LOOK_S)
                return
            alone_s = 0.0 if self._workers() else alone_s + _LOOK_S
        raise NoAnswer("no worker is left", where=self._address, todo="Start workers: dask worker ADDRESS")

    def pieces(self, work: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
        places = min(len(self._workers()), len(rows))
        if places < 2:
            return work(rows)  # a way there and back would cost more than it saves
        return np.concatenate(self.each(work, np.array_split(rows, places)))

    def _workers(self) -> list[str]:
        """Addresses of the workers, each as often as it has threads."""
        known = self._client.scheduler_info(n_workers=-1)["workers"].items()
        return [address for address, worker in known for _ in range(worker["nthreads"])]


def _unpacked(packed: bytes) -> Any:
    import cloudpickle

    return cloudpickle.loads(packed)


def _applied(work: Callable[[Any], Any], packed: bytes) -> bytes:
    import cloudpickle
    import mujoco

    # a search tries models that diverge; without this each would be told in a file of the worker's folder
    mujoco.set_mju_user_warning(lambda _: None)
    return cloudpickle.dumps(work(cloudpickle.loads(packed)))


_executor: ContextVar[Executor] = ContextVar("executor", default=Cores())  # noqa: B039 - it has no state


def places(count: int) -> int:
    """How many processes so many pieces of work get: one a core, or 1 where all is done in this process.

    So it is with one core or one piece, where work is sent to a cluster, in another thread than the main one, and on a
    system that cannot fork while libraries run threads.
    """
    return _processes(count) if isinstance(_executor.get(), Cores) else 1


def _processes(count: int) -> int:
    forks = threading.current_thread() is threading.main_thread() and sys.platform.startswith("linux")
    return min(thread_count(), count) if forks else 1


def side_by_side(
    work: Callable[[Item, Say], Result],
    items: Sequence[Item],
    say: Say,
    *,
    meanwhile: Callable[[], None] = lambda: None,
) -> Generator[tuple[int, Result], None, None]:
    """(index, work(item, say)) for each item, as they end, in as many processes as there are `places`.

    What the work raises is raised here. What one of several says is told when it has ended; `meanwhile` is called again
    and again while processes work.
    """
    if (count := places(len(items))) > 1:
        return in_processes(work, items, say, count, meanwhile)
    return ((index, work(item, say)) for index, item in enumerate(items))


def in_order(work: Callable[[Item, Say], Result], items: Sequence[Item], say: Say) -> list[Result]:
    """[work(item, say) for item in items], in order, as `side_by_side` does them."""
    found = dict(side_by_side(work, items, say))
    return [found[index] for index in range(len(items))]


def concurrently(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """[work(item) for item in items], in order, wherever work runs now."""
    check_time()  # workers of a cluster know of no limit
    return _executor.get().each(work, list(items))


def concurrently_here(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """As `concurrently`, always on this machine: for work that would take longer to send than to do."""
    return Cores().each(work, list(items))


def in_pieces(work: Callable[[np.ndarray], np.ndarray], rows: np.ndarray) -> np.ndarray:
    """work(rows) of rows (B, p), for work that treats each row alone, wherever work runs now."""
    return _executor.get().pieces(work, rows)


@contextlib.contextmanager
def on_cluster(address: str | None) -> Iterator[None]:
    """While this lasts, work runs on the Dask cluster whose scheduler is at this address; None changes nothing.

    Raises BadInput where Dask is not installed here or the workers do not have what is here, UsageError for what
    is no address, NoAnswer where nobody answers or no worker is there.
    """
    if address is None:
        yield
        return
    with _connected(address) as client:
        _require_alike(client, address)
        token = _executor.set(Cluster(client, address))
        try:
            yield
        finally:
            _executor.reset(token)


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Any]:
    try:
        from distributed import Client
        from distributed.comm.addressing import get_address_host_port
    except ImportError:
        raise BadInput(
            "Dask is not installed", where="--cluster", todo="Install the extra: pip install 'twin_daemon[cluster]'"
        ) from None
    try:
        place = get_address_host_port(address, strict=True)
    except (TypeError, ValueError):
        raise UsageError(f"'{address}' is no address", where="--cluster", allowed="tcp://HOST:PORT") from None
    try:
        socket.create_connection(place, timeout=_ANSWER_S).close()  # a client that finds nobody goes on trying
        client = Client(address, timeout=_ANSWER_S)
    except (OSError, TimeoutError):
        raise NoAnswer(
            f"no Dask scheduler answers within {_ANSWER_S:.0f} s", where=address, todo="Start one: dask scheduler"
        ) from None
    try:
        yield client
    finally:
        client.close()


def _require_alike(client: Any, address: str) -> None:
    """Raises unless workers are there and have the program and the engine that are here: both make the numbers."""
    if not client.scheduler_info()["workers"]:
        raise NoAnswer("the cluster has no worker", where=address, todo=f"Start some: dask worker {address}")
    try:
        there = client.run(_versions)
    except Exception as error:
        raise BadInput(f"its workers cannot run this program: {error}", where=address, todo=_SAME) from None
    here = _versions()
    for worker, versions in there.items():
        if versions != here:
            raise BadInput(f"has {versions}, here is {here}", where=worker, todo=_SAME)


_SAME = "Install the same version of twin_daemon on all machines"


def _versions() -> str:
    import mujoco

    import twin_daemon

    return f"twin_daemon {twin_daemon.__version__} with MuJoCo {mujoco.__version__}"
