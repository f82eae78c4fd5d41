"""All benchmarks in one command: measures, prints, and writes docs/bench.json and docs/bench.md.

    python -m bench [--quick] [--only NAME...] [--seed N] [--against FILE.json]

With --quick each benchmark takes one round and nothing is written. With --only the others keep their numbers. With
--against ratios whose spread does not meet that of an earlier run are named, and the command ends with 1.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from bench import results
from bench.catalogue import BENCHMARKS
from bench.page import page, row_text


def main() -> int:
    """0, or 1 where a run disagrees with the one that it is held against."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    names = [benchmark.name for benchmark in BENCHMARKS]
    parser.add_argument("--quick", action="store_true", help="one round of each, and no page")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="NAME", help=", ".join(names))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("docs"), help="where bench.json and bench.md are")
    parser.add_argument("--against", type=Path, help="an earlier bench.json")
    chosen = parser.parse_args()
    chosen.folder.mkdir(parents=True, exist_ok=True)
    path = chosen.folder / "bench.json"
    before = results.read(chosen.against) if chosen.against else {}
    kept, measured = results.read(path), {}
    with tempfile.TemporaryDirectory() as state:
        os.environ["TWIN_STATE_DIR"] = state  # a promoted version of the user's is not what is measured
        for benchmark in BENCHMARKS:
            if benchmark.name not in chosen.only:
                continue
            result = measured[benchmark.name] = results.measured(benchmark, chosen.quick, chosen.seed)
            print(f"{benchmark.name} ({result['wall_s']:.0f} s)", flush=True)
            for row in result["rows"]:
                print("  " + row_text(row), flush=True)
            if result["left_out"]:
                print(f"  left out: {result['left_out']}", flush=True)
            if not chosen.quick:
                known = {**kept, **measured}
                kept = {name: known[name] for name in names if name in known}
                results.write(path, kept)
                (chosen.folder / "bench.md").write_text(page(kept))
                if benchmark.draw and result["rows"]:
                    benchmark.draw(result["rows"], chosen.folder / "pictures")
    apart = results.disagreements(before, measured)
    for line in apart:
        print(f"not as before: {line}")
    return 1 if apart else 0


if __name__ == "__main__":
    sys.exit(main())
