"""Robots drawn at random, with something hidden in them or nothing: what `twin diagnose` says of them, and its score.

    python -m bench.hidden_suite --half development --count 40 --folder build/suite --page build/suite/page.md
    python -m bench.hidden_suite --half test --count 200 --plain --folder /tmp/test --page docs/hidden-suite.md
    python -m bench.hidden_suite --export DIR --half development --count 40

Even seeds are for development, odd ones for the test: the test half is run once a release and never used to tune. Cases
run on all cores of this machine, or with `--cluster tcp://...` on a Dask cluster that shares the folder. A run that was
interrupted goes on where it stopped. `--plain` fits the plain baseline (bench.plain_baseline) to the same cases.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from bench.hidden_page import page
from bench.machine import commit, in_words, provenance
from bench.random_robots.cases import Plan, plans
from bench.random_robots.export import seal
from twin_daemon.executor import concurrently, on_cluster
from twin_daemon.resources import twin_command

_INTERRUPTED = 130
_PATIENCE = 10  # seconds of the clock for a second of the processor, on a busy machine
_SAID = ("effect", "joints", "parameters", "confusable_with", "probability", "evidence", "holdout_gain")


def main() -> None:
    """Runs the cases that are not done yet, then writes the page; or writes the cases out."""
    arguments = _options().parse_args()
    chosen = plans(arguments.count, arguments.half, arguments.seed)
    if arguments.export:
        with on_cluster(arguments.cluster):
            concurrently(partial(_export, folder=arguments.export.resolve()), chosen)
        seal(arguments.export)
        return
    about = provenance(f"python -m bench.hidden_suite --half {arguments.half} --count {arguments.count}")
    run(chosen, arguments.folder, arguments.longest, arguments.cluster, tuple(arguments.diagnose), arguments.plain)
    text = page(results(chosen, arguments.folder), len(chosen), arguments.half) + f"\n{in_words(about)}\n"
    print(text)
    if arguments.page:
        arguments.page.write_text(text)


def _options() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--half", choices=("development", "test"), default="development", help="even or odd seeds")
    parser.add_argument("--count", type=int, default=200, help="how many cases (200 are a half of the suite)")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--folder", type=Path, default=Path("build/hidden-suite"), help="results, one file a case")
    parser.add_argument("--page", type=Path, help="Markdown page of what came out")
    parser.add_argument("--longest", type=float, default=300.0, help="seconds of one core that a diagnosis may take")
    parser.add_argument("--cluster", help="tcp://HOST:PORT of a scheduler, instead of this machine's cores")
    parser.add_argument("--diagnose", nargs="*", default=[], metavar="WORD", help="more words for `twin diagnose`")
    parser.add_argument("--plain", action="store_true", help="fit the plain baseline to the same cases as well")
    parser.add_argument(
        "--export", type=Path, metavar="DIR", help="only write the cases, for others (docs/suite-format.md)"
    )
    return parser


def run(
    chosen: Sequence[Plan], folder: Path, longest_s: float, cluster: str | None = None, more: tuple[str, ...] = (),
    plain: bool = False,
) -> None:  # fmt: skip
    """Makes and diagnoses the cases that are not done yet, each on one core; a line where each has run."""
    folder.mkdir(parents=True, exist_ok=True)
    with on_cluster(cluster), contextlib.suppress(KeyboardInterrupt):
        concurrently(partial(_one, folder=folder.resolve(), longest_s=longest_s, more=more, plain=plain), chosen)


def results(chosen: Sequence[Plan], folder: Path) -> list[dict[str, Any]]:
    """What is known of the cases that have run: `truth`, `said`, and `plain` where the baseline was fitted."""
    found = []
    for plan in chosen:
        truth, said = folder / f"{plan.name}.truth.json", folder / f"{plan.name}.json"
        if truth.exists() and said.exists():
            one = {"truth": json.loads(truth.read_text()), "said": json.loads(said.read_text())}
            plain = folder / f"{plan.name}.plain.json"
            if plain.exists():
                one["plain"] = json.loads(plain.read_text())
            found.append(one)
    return found


def _export(plan: Plan, folder: Path) -> None:
    if not (folder / f"{plan.name}.truth.json").exists():
        made = [sys.executable, "-m", "bench.random_robots", "--export", str(folder), "--seed", str(plan.seed)]
        subprocess.run([*made, "--count", "1"], check=True)


def _one(plan: Plan, folder: Path, longest_s: float, more: tuple[str, ...], plain: bool) -> None:
    wanted = [folder / f"{plan.name}{ending}" for ending in (".json", *([".plain.json"] if plain else []))]
    if all(path.exists() for path in wanted):
        return
    made = folder / "made" / plan.name
    shutil.rmtree(made, ignore_errors=True)
    _export(plan, made)
    (made / f"{plan.name}.truth.json").replace(folder / f"{plan.name}.truth.json")
    recordings = ["--recording", str(made / f"{plan.name}_fit"), "--holdout", str(made / f"{plan.name}_holdout")]
    model = ["--model", str(made / f"{plan.name}.xml")]
    try:
        for path in wanted:
            if path.exists():
                continue
            result = made / "said.json"
            result.unlink(missing_ok=True)
            words = [*model, *recordings, "--json", str(result)]
            command = [sys.executable, "-m", "bench.plain_baseline", *words]
            if path == wanted[0]:
                command = twin_command("diagnose", *words, *more)
            said = _answer(command, result, made / "log.txt", longest_s)
            if said is None:
                return  # interrupted: to be run again
            path.write_text(json.dumps(said, indent=1) + "\n")
            names = ", ".join(f"{f['effect']}:{(f['joints'] or ['robot'])[0]}" for f in said["findings"])
            who = "plain " if path != wanted[0] else ""
            print(f"{plan.name} {who}{said['verdict']:13s} {names}  ({said['wall_s']:.0f} s)", flush=True)
    finally:
        shutil.rmtree(made, ignore_errors=True)


def _answer(command: list[str], result: Path, log: Path, longest_s: float) -> dict[str, Any] | None:
    """What a diagnosis says, with its seconds and memory; `failed` where it says nothing; None where it was stopped."""
    environment = os.environ | {"TWIN_STATE_DIR": str(result.parent / "state"), "TWIN_THREADS": "1"}
    began = time.perf_counter()
    with log.open("w") as out:
        child = subprocess.Popen(command, stdout=out, stderr=out, env=environment)
        limit = int(np.ceil(longest_s))
        resource.prlimit(child.pid, resource.RLIMIT_CPU, (limit, limit))
        killer = threading.Timer(_PATIENCE * longest_s, child.kill)  # of one that sleeps
        killer.start()
        _, status, usage = os.wait4(child.pid, 0)
        killer.cancel()
    wall_s = time.perf_counter() - began
    child.returncode = os.waitstatus_to_exitcode(status)  # it has been waited for
    said = json.loads(result.read_text()) if result.exists() else {}
    if child.returncode == _INTERRUPTED or said.get("interrupted"):
        return None
    findings = [{key: found[key] for key in _SAID if key in found} for found in said.get("findings", [])]
    answer: dict[str, Any] = {"verdict": said.get("verdict", "failed"), "findings": findings}
    answer["probabilities"] = said.get("probabilities", [])
    answer |= {key: said[key] for key in ("reason", "parts", "causes") if key in said}
    if not said:
        stopped = child.returncode in (-signal.SIGKILL, -signal.SIGXCPU)
        answer["why"] = f"not ended after {longest_s:g} s" if stopped else log.read_text().strip()[-300:]
    processor_s = usage.ru_utime + usage.ru_stime
    measured = {"wall_s": wall_s, "processor_s": processor_s, "memory_mb": usage.ru_maxrss / 1024}
    return answer | {key: round(value, 1) for key, value in measured.items()} | {"commit": commit()}


if __name__ == "__main__":
    main()
