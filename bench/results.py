"""Results of benchmarks as JSON: each with the machine, the versions, the date, the commit and the command."""

from __future__ import annotations

import json
import time
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench.frame import Benchmark, LeftOut
from bench.machine import provenance

SCHEMA = 1


def measured(benchmark: Benchmark, quick: bool, seed: int) -> dict[str, Any]:
    """One benchmark's result. What this machine lacks is a result, too."""
    began = time.monotonic()
    about = {
        "name": benchmark.name,
        "compares": benchmark.compares,
        "reading": benchmark.reading,
        **provenance(f"python -m bench{' --quick' if quick else ''} --only {benchmark.name} --seed {seed}"),
    }
    try:
        return {**about, "rows": [asdict(row) for row in benchmark.measure(quick, seed)], "left_out": None,
                "wall_s": time.monotonic() - began}  # fmt: skip
    except LeftOut as reason:
        return {**about, "rows": [], "left_out": str(reason), "wall_s": time.monotonic() - began}


def read(path: Path) -> dict[str, dict[str, Any]]:
    """Results by name of benchmark; none where there is no file yet."""
    if not path.exists():
        return {}
    return {result["name"]: result for result in json.loads(path.read_text())["benchmarks"]}


def write(path: Path, results: dict[str, dict[str, Any]]) -> None:
    """Results by name of benchmark, in their order."""
    whole = {"schema": SCHEMA, "benchmarks": list(results.values())}
    path.write_text(json.dumps(whole, indent=1, ensure_ascii=False) + "\n")


def disagreements(before: dict[str, dict[str, Any]], after: dict[str, dict[str, Any]]) -> list[str]:
    """The ratios of one run that lie outside the spread of the other, in words; none where two runs agree."""
    out = []
    for name, result in after.items():
        known = {row["what"]: row for row in before.get(name, {"rows": []})["rows"]}
        for row in result["rows"]:
            old = known.get(row["what"])
            if old is None or row["spread"] is None or old["spread"] is None:
                continue
            (low, high), (other_low, other_high) = row["spread"], old["spread"]
            if low > other_high or high < other_low:
                out.append(
                    f"{name}, {row['what']}: {row['ratio']:.3g} ({low:.3g} to {high:.3g}), "
                    f"before {old['ratio']:.3g} ({other_low:.3g} to {other_high:.3g})"
                )
    return out
