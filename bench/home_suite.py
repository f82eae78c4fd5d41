"""Makes the plants of the home suite, lets `twin diagnose` look at their recordings, and scores what it says.

    python -m bench.home_suite --folder /tmp/suite --page docs/home-suite.md

Cases run on all cores of this machine, or with `--cluster tcp://...` on a Dask cluster that shares the folder. A run
that was interrupted goes on where it stopped. Answers are opened after all diagnoses are in.
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
from functools import partial
from pathlib import Path

from bench.home_cases import Case, cases
from bench.home_page import page
from bench.machine import in_words, provenance
from twin_daemon.executor import concurrently, on_cluster

_INTERRUPTED = 130


def main() -> None:
    """Runs the cases that are not done yet, then writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--folder", type=Path, required=True, help="recordings, answers and diagnoses")
    parser.add_argument("--page", type=Path, help="Markdown page with the confusion matrix")
    parser.add_argument("--only", default="", help="part of the names of the cases to run")
    parser.add_argument("--longest", type=float, default=1200.0, help="seconds that one diagnosis may take")
    parser.add_argument("--cluster", help="tcp://HOST:PORT of a scheduler, instead of this machine's cores")
    arguments = parser.parse_args()
    chosen = [case for case in cases() if arguments.only in case.name]
    about = provenance("python -m bench.home_suite")
    run(chosen, arguments.folder, arguments.longest, arguments.cluster)
    done = [case for case in chosen if (arguments.folder / f"{case.name}.json").exists()]
    text = page(done, arguments.folder, len(cases())) + f"\n{in_words(about)}\n"
    print(text)
    if arguments.page:
        arguments.page.write_text(text)


def run(chosen: Sequence[Case], folder: Path, longest_s: float, cluster: str | None = None) -> None:
    """Makes and diagnoses the cases that are not done yet, each on one core; a line where each has run."""
    folder.mkdir(parents=True, exist_ok=True)
    # in a mixed order, so that what an interrupted run has done is a fair sample
    mixed = random.Random(0).sample(chosen, len(chosen))
    with on_cluster(cluster), contextlib.suppress(KeyboardInterrupt):
        concurrently(partial(_one, folder=folder.resolve(), longest_s=longest_s), mixed)


def _one(case: Case, folder: Path, longest_s: float) -> None:
    result = folder / f"{case.name}.json"
    if result.exists():
        return
    for which in ("fit", "held"):
        made = [sys.executable, "-m", "bench.home_plant", case.name, which, str(folder)]
        subprocess.run(made, check=True)
    began = time.perf_counter()
    told = ["diagnose", "--recording", str(folder / f"{case.name}-fit.mcap"), "--holdout",
            str(folder / f"{case.name}-held.mcap"), "--json", str(result)]  # fmt: skip
    environment = os.environ | {"TWIN_STATE_DIR": str(folder / "state" / case.name), "TWIN_THREADS": "1"}
    command = [str(Path(sys.executable).parent / "twin"), *told]
    code = None
    with (folder / f"{case.name}.log").open("w") as log, contextlib.suppress(subprocess.TimeoutExpired):
        ran = subprocess.run(command, stdout=log, stderr=log, env=environment, timeout=longest_s, check=False)
        code = ran.returncode
    seconds = time.perf_counter() - began
    failed = {"verdict": "failed", "findings": [], "wall_s": seconds}
    said = json.loads(result.read_text()) if result.exists() else failed
    if code == _INTERRUPTED or said.get("interrupted"):
        result.unlink(missing_ok=True)  # to be run again
        return
    if said is failed:
        result.write_text(json.dumps(failed))
    names = ", ".join(f"{f['effect']}:{f['joints'][0] if f['joints'] else '-'}" for f in said["findings"])
    print(f"{case.name:45s} {said['verdict']:13s} {names}  ({seconds:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
