"""What a benchmark is: a name, what it compares, and a function that measures it.

A benchmark measures two things in turn, in one process and on one machine, and reports their ratio with its spread:
machines are shared, and what disturbs one disturbs its neighbour. Seconds alone say little elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np


class LeftOut(Exception):
    """This machine lacks what the benchmark needs; the text says what."""


@dataclass(frozen=True)
class Row:
    """One comparison. `ratio` is ours over theirs, `spread` the least and the greatest of it over the rounds.

    `unit` is that of `ours` and `theirs`. `met` says whether the goal, in words, is reached; None where there is none.
    """

    what: str
    ours: float | None
    theirs: float | None = None
    unit: str = "s"
    ratio: float | None = None
    spread: tuple[float, float] | None = None
    goal: str = ""
    met: bool | None = None
    note: str = ""


@dataclass(frozen=True)
class Benchmark:
    """`measure(quick, seed)` takes minutes, or seconds where `quick`. `reading` says how its rows are to be read.

    `draw(rows, folder)` makes the picture that the reading shows, where there is one.
    """

    name: str
    compares: str
    measure: Callable[[bool, int], Sequence[Row]]
    reading: str = ""
    draw: Callable[[Sequence[Mapping[str, Any]], Path], None] | None = None


def ratio_row(
    what: str,
    ours: Sequence[float],
    theirs: Sequence[float],
    *,
    unit: str = "s",
    least: float | None = None,
    most: float | None = None,
    note: str = "",
) -> Row:
    """The row of measurements that were taken in turn: medians, and the ratio round by round.

    `least` or `most` is the goal of the ratio.
    """
    ratios = np.array(ours) / np.array(theirs)
    ratio = float(np.median(ratios))
    goal, met = "", None
    if least is not None:
        goal, met = f"at least {least:g}", ratio >= least
    if most is not None:
        goal, met = f"at most {most:g}", ratio <= most
    spread = (float(ratios.min()), float(ratios.max()))
    return Row(what, float(np.median(ours)), float(np.median(theirs)), unit, ratio, spread, goal, met, note)
