"""The same hidden effects under other conditions: another plant and motion, noisier sensors, less time.

    python -m bench.conditions --folder /tmp/conditions --page docs/conditions.md

A run that was interrupted goes on where it stopped. At the end each candidate of one diagnosis is timed on its own.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from bench.by_candidate import seconds_by_candidate
from bench.home_cases import Case, conditions
from bench.home_page import outcome
from bench.home_suite import run
from bench.machine import in_words, provenance

_INTRODUCTION = """# The diagnosis under other conditions

Made by `python -m bench.conditions`. Plants as in the [home suite](home-suite.md): one finger, parameters up to
20 % off. Unless the column says otherwise, 16 s of rich motion to fit, 8 s of other motion held out. A ✗ is a wrong
answer: a wrong name, an effect of the library that was not named, or a name where there is none. Poor motion has
[a page of its own](poor-motion.md).
"""


def main() -> None:
    """Runs the cases that are not done yet, times the candidates, and writes the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--folder", type=Path, required=True, help="recordings, answers and diagnoses")
    parser.add_argument("--page", type=Path, help="Markdown page with both tables")
    parser.add_argument("--longest", type=float, default=1200.0, help="seconds that one diagnosis may take")
    parser.add_argument("--cluster", help="tcp://HOST:PORT of a scheduler, instead of this machine's cores")
    arguments = parser.parse_args()
    under = conditions()
    about = provenance("python -m bench.conditions")
    everything = [case for cases in under.values() for case in cases]
    run(everything, arguments.folder, arguments.longest, arguments.cluster)
    timed = next(case for case in next(iter(under.values())) if case.kind == "single")
    lines = [_INTRODUCTION, *table(under, arguments.folder), "", "## Time by candidate", ""]
    lines += [
        f"Seconds of the processor for each candidate at one place, with `{timed.hidden[0]}` hidden: screened along",
        "its secants, rolled out from its best start, the first fit, and the full fit on all motion. A diagnosis does",
        "the last two only for the best.",
        "",
        "| effect | screened | rolled out | first fit | full fit |",
        "|---|---|---|---|---|",
    ]
    for key, steps in seconds_by_candidate(arguments.folder / f"{timed.name}-fit.mcap").items():
        lines.append(f"| {key} | " + " | ".join("-" if s is None else f"{s:.2f}" for s in steps) + " |")
    lines += ["", in_words(about)]
    text = "\n".join(lines) + "\n"
    print(text)
    if arguments.page:
        arguments.page.write_text(text, encoding="utf-8")


def table(under: dict[str, list[Case]], folder: Path) -> list[str]:
    """A row for what was hidden, a column for each condition: the verdict, and what was named first."""
    out = ["| hidden | " + " | ".join(under) + " |", "|---" * (len(under) + 1) + "|"]
    for row in zip(*under.values(), strict=True):
        cells = [_cell(case, folder) for case in row]
        out.append(f"| {', '.join(row[0].hidden) or 'nothing'} | " + " | ".join(cells) + " |")
    return out


def _cell(case: Case, folder: Path) -> str:
    said = outcome(case, folder)
    named = said["named"].partition(", ")[0]
    words = said["verdict"] + (f", {named}" if named else "")
    return words if said["right"] else f"{words} ✗"


if __name__ == "__main__":
    main()
