"""Writes cases of robots drawn at random.

python -m bench.random_robots --export DIR [--half development|test] [--count N] [--seed S] [--model-error KIND]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .cases import build, plans
from .export import export
from .plants import MODEL_ERRORS


def main() -> None:
    """Makes the cases that are not there yet."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--export", type=Path, required=True, metavar="DIR", help="folder of the cases")
    parser.add_argument("--half", choices=("development", "test"), help="even or odd seeds (default: both)")
    parser.add_argument("--count", type=int, default=40, help="how many cases")
    parser.add_argument("--seed", type=int, default=0, help="the first seed")
    parser.add_argument("--kind", help="only cases of this kind: nothing, single, robot, foreign, pair")
    parser.add_argument("--model-error", choices=list(MODEL_ERRORS), help="what nominal models are off by (drawn)")
    chosen = parser.parse_args()
    for plan in plans(chosen.count, chosen.half, chosen.seed):
        if chosen.kind not in (None, plan.kind) or (chosen.export / f"{plan.name}.truth.json").exists():
            continue
        export(build(plan, chosen.model_error), chosen.export)
        print(plan.name, flush=True)


if __name__ == "__main__":
    main()
