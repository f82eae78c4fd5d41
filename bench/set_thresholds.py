"""The numbers behind the probabilities of a diagnosis, set on development cases of the hidden suite.

    python -m bench.set_thresholds --folder build/suite     # results of python -m bench.hidden_suite --half development

What was found and what is left in each part is in the results; the numbers that make probabilities of it are tried over
a grid. The best give what came true the highest probabilities, by the mean of their logarithms (Good 1952). Beside them
stand the numbers in use, and how much each matters: what is lost where that one alone is halved or doubled. Cases of
the test half are refused.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from bench.random_robots.score import is_cause
from twin_daemon.diagnosis.probability import IN_USE, Beliefs, Left, combined

_GRID: dict[str, tuple[float, ...]] = {
    "unknown_above": (0.06, 0.12, 0.24),
    "slope": (1.5, 2.0, 2.5, 3.0, 4.0, 6.0, 12.0),
    "least_adequacy": (0.1, 0.2, 0.4, 0.6),
    "further_cause_odds": (1.0, 2.0, 4.0, 8.0),
    "too_weak": (0.1, 0.2, 0.3, 0.4),
}
_LEAST = 0.005  # probability of what is not listed: half of the least that is
_BINS = 5


@dataclass(frozen=True)
class Case:
    """One answer and what was hidden: distributions over each place among the causes, and what is left by part."""

    truth: dict[str, Any]
    causes: list[dict[str, float]]
    left: list[Left]

    def said(self, beliefs: Beliefs) -> list[tuple[float, bool]]:
        """(probability, whether it came true) of each set of causes, the most probable first."""
        found = combined(self.causes, [one.unknown(len(self.causes), beliefs) for one in self.left], beliefs)
        return [(one.probability, is_cause(list(one.effects), self.truth)) for one in found]


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--folder", type=Path, default=Path("build/suite"), help="results of the hidden suite")
    cases = list(known(parser.parse_args().folder))
    if not cases:
        raise SystemExit("no development case with an answer is there: run python -m bench.hidden_suite first")
    every = (Beliefs(**dict(zip(_GRID, values, strict=True))) for values in product(*_GRID.values()))
    best = max(every, key=lambda beliefs: score(cases, beliefs))
    print(f"{len(cases)} cases\n\n| number | in use | best of the grid | lost if halved | if doubled |\n{'|---' * 5}|")
    used, found = asdict(IN_USE), asdict(best)
    for name in _GRID:
        lost = [score(cases, IN_USE) - score(cases, replace(IN_USE, **{name: f * used[name]})) for f in (0.5, 2.0)]
        print(f"| {name} | {used[name]:g} | {found[name]:g} | {lost[0]:+.3f} | {lost[1]:+.3f} |")
    for label, beliefs in (("in use", IN_USE), ("best of the grid", best)):
        mean, error = score(cases, beliefs), calibration_error(cases, beliefs)
        print(f"\n{label}: mean logarithm {mean:.3f}, expected calibration error {error:.3f}")


def known(folder: Path) -> Iterator[Case]:
    """The development cases that have an answer. Ends the program at one of the test half."""
    for path in sorted(folder.glob("*.truth.json")):
        result = path.with_name(path.name.replace(".truth", ""))
        truth = json.loads(path.read_text())
        if truth["half"] != "development":
            raise SystemExit(f"{path}: a case of the test half; numbers are set on development cases alone")
        said = json.loads(result.read_text()) if result.exists() else {}
        if said.get("probabilities"):
            parts = said["parts"].values()
            left = [Left(part["adequacy"], part["above"], part["named"]) for part in parts]
            yield Case(truth, said["causes"], left)


def score(cases: Sequence[Case], beliefs: Beliefs) -> float:
    """Mean logarithm of the probability that was given to what came true."""
    told = [sum(p for p, came_true in case.said(beliefs) if came_true) for case in cases]
    return float(np.log(np.maximum(told, _LEAST)).mean())


def calibration_error(cases: Sequence[Case], beliefs: Beliefs) -> float:
    """Expected calibration error of the most probable set, in bins of as many answers each."""
    first = sorted(case.said(beliefs)[0] for case in cases)
    bins = [np.array(one, float) for one in np.array_split(np.array(first, float), min(_BINS, len(first)))]
    return float(sum(len(one) / len(first) * abs(one[:, 0].mean() - one[:, 1].mean()) for one in bins))


if __name__ == "__main__":
    main()
