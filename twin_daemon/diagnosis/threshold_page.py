"""docs/thresholds.md, made of what the code has."""

from __future__ import annotations

from collections.abc import Iterator
from types import ModuleType

from twin_daemon.diagnosis import thresholds as of_diagnosis
from twin_daemon.estimation import thresholds as of_estimation
from twin_daemon.estimation.thresholds import Count, Threshold

_INTRODUCTION = """# Thresholds

Made by `twin config thresholds -o docs/thresholds.md`. Every number that a fit or a diagnosis decides by, as the code
has it: its unit (1 is a share or a factor), what it decides and where it comes from. They were found on the hidden
suite's plants and on the measured hand unless a line says otherwise.
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
    lines += [f"| {name} | {value:.4g} | {value.unit} | {value.why} |" for name, value in entries(module)]
    return "\n".join(lines) + "\n"


def entries(module: ModuleType) -> Iterator[tuple[str, Threshold | Count]]:
    """(name, value) of each number that a module states itself, in its order."""
    stated = vars(module).items()
    taken = set(vars(of_estimation)) if module is not of_estimation else set()
    return ((n, v) for n, v in stated if isinstance(v, (Threshold, Count)) and n not in taken)
