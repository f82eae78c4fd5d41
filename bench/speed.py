"""What the ways of doing the work are worth: each against the plain way to the same answer, in one run."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from bench.frame import Row, ratio_row
from twin_daemon.calibration.spaces import load_space, variables_of
from twin_daemon.estimation.partition import restricted
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.subproblems import reduced_problems
from twin_daemon.hand import load_hand
from twin_daemon.plant import Plant
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record
from twin_daemon.recordings import load_recording
from twin_daemon.resources import twin_command
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.submodel import submodel
from twin_daemon.simulation.twin import TwinModel

_SECONDS = 20.0
_CANDIDATES = 8
_EVERYTHING = "mujoco, zenoh, numpy, scipy.optimize, plotly.graph_objects, skopt, rosbags.highlevel, pydantic, typer"

READING = (
    "Ours is how the work is done; theirs does the same without that. One finger is rolled out on a model of the "
    "finger alone; where fingers touch, each is fitted to the time in which it does not, so that a value costs a "
    "roll-out of one finger over that time; a recording's chunks are read as tables rather than message by message; "
    "commands load what they need when they are called."
)
"""How the rows are to be read."""


def speed(quick: bool, seed: int) -> Sequence[Row]:
    """Seconds of the way that is taken and of the plain one."""
    hand = load_hand()
    twin = TwinModel.load(hand)
    rounds = 1 if quick else 5
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "rich.mcap"
        record(Plant(hand, seed=seed, spread=0.1), rich(hand, (), _SECONDS, seed), path)
        aligned = align(twin, load_recording(path))
        works = {
            f"{_CANDIDATES} candidates of one finger: its own model, the whole hand": _finger(twin, aligned),
            "one step of each value of a hand whose fingers touch: by finger, by hand": _touching(twin, aligned),
            f"{_SECONDS:.0f} s of a recording: by chunk, by message": (
                lambda: load_recording(path),
                lambda: _by_message(path),
            ),
            "`twin --help`, and its libraries alone": (
                lambda: _run(twin_command("--help")),
                lambda: _run([sys.executable, "-c", f"import {_EVERYTHING}"]),
            ),
        }
        return [_row(what, ours, theirs, rounds) for what, (ours, theirs) in works.items()]


Work = Callable[[], object]


def _row(what: str, ours: Work, theirs: Work, rounds: int) -> Row:
    taken: tuple[list[float], list[float]] = ([], [])
    for _ in range(rounds):
        for work, times in zip((ours, theirs), taken, strict=True):
            began_s = time.perf_counter()
            work()
            times.append(time.perf_counter() - began_s)
    return ratio_row(what, *taken)


def _finger(twin: TwinModel, aligned: Aligned) -> tuple[Work, Work]:
    joints = tuple(n for n in twin.joints if n.startswith("rh_FF"))
    small = submodel(twin, joints, aligned.start_position)
    problems = []
    for model, recording in ((small, restricted(aligned, small)), (twin, aligned)):
        problems.append(Problem(model, [recording], variables_of(load_space("wear"), model, joints), joints))
    works = [_residuals(problem, _CANDIDATES) for problem in problems]
    return works[0], works[1]


def _touching(twin: TwinModel, aligned: Aligned) -> tuple[Work, Work]:
    moving = tuple(n for n, moves in zip(twin.joints, aligned.moving, strict=True) if moves)
    variables = variables_of(load_space("wear"), twin, moving)
    parts = reduced_problems(twin, [aligned], variables, moving, separable=True)
    turned = {variable.name for sub in parts for variable in sub.problem.variables}
    same = [variable for variable in variables if variable.name in turned]
    joints = [name for name in moving if any(name in sub.problem.objective for sub in parts)]
    whole = Problem(twin, [aligned], same, joints)
    each = [_residuals(sub.problem, len(sub.problem.variables)) for sub in parts]
    return (lambda: [work() for work in each]), _residuals(whole, len(same))


def _residuals(problem: Problem, count: int) -> Work:
    points = np.repeat(problem.start[None], count, axis=0)
    return lambda: problem.residuals(points)


def _by_message(path: Path) -> int:
    with AnyReader([path]) as reader:
        return len([reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()])


def _run(command: list[str]) -> None:
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
