"""Makes the plants of the hidden suite, lets `twin diagnose` look at their recordings, and scores what it says.

    python -m bench.hidden_suite --folder /tmp/suite --page docs/hidden-suite.md

A run that was interrupted goes on where it stopped. Answers are opened after all diagnoses are in.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from bench.suite_cases import Case, cases
from bench.suite_page import page


def main() -> None:
    """Runs the cases that are not done yet, then writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--folder", type=Path, required=True, help="recordings, answers and diagnoses")
    parser.add_argument("--page", type=Path, help="Markdown page with the confusion matrix")
    parser.add_argument("--only", default="", help="part of the names of the cases to run")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--longest", type=float, default=1200.0, help="seconds that one diagnosis may take")
    arguments = parser.parse_args()
    chosen = [case for case in cases() if arguments.only in case.name]
    run(chosen, arguments.folder, arguments.workers, arguments.longest)
    done = [case for case in chosen if (arguments.folder / f"{case.name}.json").exists()]
    text = page(done, arguments.folder, len(cases()))
    print(text)
    if arguments.page:
        arguments.page.write_text(text)


def run(chosen: Sequence[Case], folder: Path, workers: int, longest_s: float) -> None:
    """Makes and diagnoses the cases that are not done yet, `workers` at once on one core each; a line for each."""
    folder.mkdir(parents=True, exist_ok=True)
    with ThreadPoolExecutor(workers) as pool:
        # in a mixed order, so that what an interrupted run has done is a fair sample
        mixed = random.Random(0).sample(chosen, len(chosen))
        try:
            for line in pool.map(lambda case: _one(case, folder, longest_s), mixed):
                print(line, flush=True)
        except KeyboardInterrupt:
            pool.shutdown(cancel_futures=True)


def _one(case: Case, folder: Path, longest_s: float) -> str:
    result = folder / f"{case.name}.json"
    if not result.exists():
        for which in ("fit", "held"):
            made = [sys.executable, "-m", "bench.suite_plant", case.name, which, str(folder)]
            subprocess.run(made, check=True)
        began = time.perf_counter()
        told = ["diagnose", "--recording", str(folder / f"{case.name}-fit.mcap"), "--holdout",
                str(folder / f"{case.name}-held.mcap"), "--json", str(result)]  # fmt: skip
        environment = os.environ | {"TWIN_STATE_DIR": str(folder / "state" / case.name), "TWIN_THREADS": "1"}
        command = [str(Path(sys.executable).parent / "twin"), *told]
        with (folder / f"{case.name}.log").open("w") as log, contextlib.suppress(subprocess.TimeoutExpired):
            subprocess.run(command, stdout=log, stderr=log, env=environment, timeout=longest_s, check=False)
        seconds = time.perf_counter() - began
        if not result.exists():
            result.write_text(json.dumps({"verdict": "failed", "findings": [], "wall_s": seconds}))
    else:
        seconds = float("nan")
    said = json.loads(result.read_text())
    names = ", ".join(f"{f['effect']}:{f['joints'][0] if f['joints'] else '-'}" for f in said["findings"])
    return f"{case.name:45s} {said['verdict']:13s} {names}  ({seconds:.0f} s)"


if __name__ == "__main__":
    main()
