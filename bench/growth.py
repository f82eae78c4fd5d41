"""What a batch of candidates costs as a fit grows: joints, candidates, recordings, and their length."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.frame import Row
from bench.picture import picture
from twin_daemon.calibration.spaces import Space, variables_of
from twin_daemon.estimation.partition import restricted
from twin_daemon.estimation.problem import Problem
from twin_daemon.figures.style import DOWN, REFERENCE, RESIDUAL, TWIN, UP
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record
from twin_daemon.processor_time import thread_count
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.submodel import submodel
from twin_daemon.simulation.twin import TwinModel

_LONGEST_S = 64.0
_USUAL_S = 4.0
_USUAL_CANDIDATES = 8
_FINGERS = (("FF",), ("FF", "MF"), ("FF", "MF", "RF"), ("FF", "MF", "RF", "LF"), ("FF", "MF", "RF", "LF", "TH", "WR"))
_SPACE = Space.model_validate(
    {"schema": 1, "name": "damping", "about": "one damping for all", "parameters": [
        {"kind": "damping", "of": ["moving"], "share": True, "lower": 0.01, "upper": 0.2}]}
)  # fmt: skip

Work = Callable[[], object]


def growth(quick: bool, seed: int) -> Sequence[Row]:
    """Seconds by size. `theirs` is what the smallest size would grow to in proportion, so that a ratio of 1 is "
    "linear."""
    hand = load_hand()
    twin = TwinModel.load(hand)
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "rich.mcap"
        record(Plant(hand, seed=seed, spread=0.1), rich(hand, (), _LONGEST_S + 1.0, seed), path)
        whole = load_recording(path)

    def part(fingers: Sequence[str], length_s: float) -> tuple[TwinModel, Aligned]:
        aligned = align(twin, whole.window(0.0, length_s))
        keep = tuple(n for n in twin.joints if n.removeprefix("rh_").startswith(tuple(fingers)))
        small = submodel(twin, keep, aligned.start_position)
        return small, restricted(aligned, small)

    def batch(fingers: Sequence[str], candidates: int, recordings: int, length_s: float) -> Work:
        small, aligned = part(fingers, length_s)
        variables = variables_of(_SPACE, small, small.joints)
        problem = Problem(small, [aligned] * recordings, variables, small.joints)
        points = rng.random((candidates, len(variables)))
        return lambda: problem.residuals(points)

    finger, usual = _FINGERS[0], (_USUAL_CANDIDATES, 1, _USUAL_S)
    works: dict[str, dict[int, Work]] = {
        "joints": {len(part(f, _USUAL_S)[0].joints): batch(f, *usual) for f in _FINGERS},
        "candidates": {n: batch(finger, n, 1, _USUAL_S) for n in (1, 2, 4, 8, 16, 32, 64, 128)},
        "recordings": {n: batch(finger, _USUAL_CANDIDATES, n, _USUAL_S) for n in (1, 2, 4, 8, 16)},
        "seconds of motion": {n: batch(finger, _USUAL_CANDIDATES, 1, n) for n in (2, 4, 8, 16, 32, 64)},
    }
    rows = []
    for what, sizes in works.items():
        times = {size: [] for size in sizes}
        for _ in range(1 if quick else 5):
            for size, work in sizes.items():
                began = time.perf_counter()
                work()
                times[size].append(time.perf_counter() - began)
        smallest = min(sizes)
        for size, taken in times.items():
            linear = np.array(times[smallest]) * size / smallest
            ratios = np.array(taken) / linear
            spread = (float(ratios.min()), float(ratios.max()))
            rows.append(Row(f"{what}: {size}", float(np.median(taken)), float(np.median(linear)), "s",
                            float(np.median(ratios)), spread))  # fmt: skip
    return rows


READING = (
    "Here `theirs` is the smallest size in proportion: a ratio of 1 is growth in proportion, and one below is "
    f"better. A batch of {_USUAL_CANDIDATES} candidates of one finger over {_USUAL_S:g} s of motion, one of the four "
    "grown at a time. From two candidates on the second core helps, and what each batch costs once fades with length "
    "and joints. Recordings cost in proportion and a little more, since one is rolled out after the other. A fit "
    "whose parts touch nothing is cut into fingers, and recordings longer than 40 s into stretches, so that these "
    "costs end there.\n\n![cost by size](pictures/growth.svg)"
)
"""How the rows are to be read."""


def draw(rows: Sequence[Mapping[str, Any]], folder: Path) -> None:
    """Cost over size, both as multiples of the smallest; the thin line is growth in proportion."""
    with picture(folder / "growth.svg") as axes:
        looks = zip(dict.fromkeys(row["what"].partition(":")[0] for row in rows), (TWIN, RESIDUAL, UP, DOWN), "os^D",
                    strict=False)  # fmt: skip
        for what, colour, mark in looks:
            own = [row for row in rows if row["what"].startswith(f"{what}:")]
            sizes = np.array([float(row["what"].rpartition(":")[2]) for row in own])
            costs = np.array([row["ours"] for row in own])
            axes.plot(sizes / sizes[0], costs / costs[0], mark + "-", color=colour, label=what)
        ends = np.array([1.0, 128.0])
        axes.plot(ends, ends, color=REFERENCE, linewidth=0.8)
        title = f"Cost by size, {thread_count()} threads"
        axes.set(xscale="log", yscale="log", xlabel="size", ylabel="cost", title=title)
