"""docs/thresholds.md, made of what the code has."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

from twin_daemon.diagnosis import thresholds as of_diagnosis
from twin_daemon.estimation import thresholds as of_estimation
from twin_daemon.estimation.thresholds import Count, Threshold

_INTRODUCTION = """# Thresholds

Made by `twin config thresholds -o docs/thresholds.md`. Every number that a fit or a diagnosis decides by, as the code
has it: its unit (1 is a share or a factor), what it decides and where it comes from. Read a row as one phrase: value,
unit, text ("0.005 of a variable's range: ..."). A part is a group of joints that is simulated by itself, a floor is the
mean square that a right model leaves, and a nuisance is an uncertain parameter of the model that is fitted beside an
effect ([glossary](glossary.md)). The numbers were found on the hidden suite's robots and on the measured hand unless a
row says otherwise, those of proposals on the development half of `python -m bench.proposals`.
"""


def page(*more: tuple[str, ModuleType]) -> str:
    """The page as Markdown: a table for estimation and calibration, one for the diagnosis, and those of `more`."""
    tables = [
        _table("Estimation and calibration", of_estimation),
        _table("Diagnosis", of_diagnosis),
        *(_table(title, module) for title, module in more),
    ]
    return "\n".join([_INTRODUCTION, *tables])


def _table(title: str, module: ModuleType) -> str:
    lines = [f"## {title}\n", "| name | value | unit | what it decides, and where it comes from |", "|---|---|---|---|"]
    rows: dict[tuple[str, str, str], list[str]] = {}
    for name, value in entries(module):
        rows.setdefault((name, value.unit, value.why), []).append(f"{value:.4g}")
    lines += [f"| {name} | {', '.join(values)} | {unit} | {why} |" for (name, unit, why), values in rows.items()]
    return "\n".join(lines) + "\n"


def entries(module: ModuleType) -> Iterator[tuple[str, Threshold | Count]]:
    """(name, value) of each number that a module states itself, in its order; those of a row share its name."""
    taken = vars(of_estimation) if module is not of_estimation else {}
    for name, stated in vars(module).items():
        if taken.get(name) is not stated:  # one that is imported, not one of the same name
            row = stated if isinstance(stated, tuple) else (stated,)
            yield from ((name, value) for value in row if isinstance(value, (Threshold, Count)))
