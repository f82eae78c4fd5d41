"""Hostile inputs through all that reads what others wrote: no crash, no hang, errors of the stated kind alone.

`python -m bench.fuzz --inputs 100000` divides the inputs among its targets: CDR messages, YAML, configuration and
environment, gate requests, recordings of every form, MJCF. Each target runs in a process of its own, so that a crash of
native code is noticed and named; an input that takes longer than HANG_S ends it with a traceback. What breaks is shrunk
by hypothesis.
"""

from __future__ import annotations

import argparse
import faulthandler
import multiprocessing
import tempfile
import time
from collections import Counter
from pathlib import Path

from hypothesis import HealthCheck, Phase, given, seed, settings

from bench.fuzz_targets import TARGETS, Prepared

HANG_S = 20.0
SHARES = {"cdr": 0.4, "requests": 0.33, "yaml": 0.05, "config": 0.05, "recordings": 0.1, "mjcf": 0.07}
"""By how fast a target is: a recording is a file that is written and read."""


def run(name: str, inputs: int, number: int, folder: Path) -> Counter[str]:
    """`inputs` inputs through one target; counts of what became of them. Raises what the target should not have."""
    prepared: Prepared = TARGETS[name](folder)
    counts: Counter[str] = Counter()

    @seed(number)
    @settings(
        max_examples=inputs,
        deadline=None,
        database=None,
        phases=(Phase.generate, Phase.shrink),
        suppress_health_check=(HealthCheck.too_slow, HealthCheck.data_too_large, HealthCheck.large_base_example),
    )
    @given(prepared.inputs)
    def one(value: object) -> None:
        counts[prepared.try_one(value)] += 1

    one()
    return counts


def _child(name: str, inputs: int, number: int, folder: str, results: multiprocessing.SimpleQueue[object]) -> None:
    prepared = TARGETS[name]

    def watched(place: Path) -> Prepared:
        made = prepared(place)

        def try_one(value: object) -> str:
            faulthandler.dump_traceback_later(HANG_S, exit=True)
            try:
                return made.try_one(value)
            finally:
                faulthandler.cancel_dump_traceback_later()

        return Prepared(made.inputs, try_one)

    TARGETS[name] = watched
    results.put(dict(run(name, inputs, number, Path(folder))))


def in_child(name: str, inputs: int, number: int) -> Counter[str]:
    """The same in a process of its own. Raises RuntimeError where that ends in any other way than with its counts."""
    context = multiprocessing.get_context("spawn")
    results: multiprocessing.SimpleQueue[object] = context.SimpleQueue()
    with tempfile.TemporaryDirectory() as folder:
        child = context.Process(target=_child, args=(name, inputs, number, folder, results))
        child.start()
        child.join()
        if child.exitcode != 0:
            raise RuntimeError(f"{name}: ended with {child.exitcode}; its last words are above")
        found = results.get()
    assert isinstance(found, dict)
    return Counter(found)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--targets", nargs="+", choices=sorted(SHARES), default=list(SHARES))
    given_ = parser.parse_args()
    whole = sum(SHARES[name] for name in given_.targets)
    failed, tried = [], 0
    for name in given_.targets:
        inputs, began_s = round(given_.inputs * SHARES[name] / whole), time.monotonic()
        try:
            counts = in_child(name, inputs, given_.seed)
        except RuntimeError as error:
            print(error, flush=True)
            failed.append(name)
            continue
        tried += counts.total()
        said = ", ".join(f"{count} {kind}" for kind, count in counts.most_common())
        print(f"{name}: {counts.total()} inputs in {time.monotonic() - began_s:.0f} s: {said}", flush=True)
    print(f"{tried} inputs; {'failed: ' + ', '.join(failed) if failed else 'no crash, no hang'}")
    return 1 if failed else 0


if __name__ == "__main__":
    raise SystemExit(main())
