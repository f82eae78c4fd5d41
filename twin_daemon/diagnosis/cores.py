"""Independent work on all cores. Roll-outs leave the interpreter's lock, so threads are enough."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from twin_daemon.simulation.rollout import thread_count

Item = TypeVar("Item")
Result = TypeVar("Result")


def concurrently(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """[work(item) for item in items], in order; the results do not depend on how many cores there are."""
    listed = list(items)
    with ThreadPoolExecutor(max_workers=thread_count()) as pool:
        waiting = [pool.submit(work, item) for item in listed]
        try:
            return [future.result() for future in waiting]
        except BaseException:
            for future in waiting:
                future.cancel()
            raise
