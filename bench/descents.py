"""Descents side by side on problems of the project: after how many roll-outs each has come how far.

    python -m bench.descents [--only NAME...]

Every point whose residuals are asked for counts as one roll-out, those of a Jacobian among them. All start at the same
point, in the same bounds; scipy gets the same finite differences as a callable Jacobian.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np
from mujoco import minimize
from scipy import optimize
from threadpoolctl import threadpool_limits

from bench.frame import LeftOut
from tests.simulation.made import FINGER, recorded
from twin_daemon.calibration.spaces import load_space, objective_of, variables_of
from twin_daemon.diagnosis.candidates import hypotheses
from twin_daemon.diagnosis.fit import own_columns
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.estimation.partition import Reduction
from twin_daemon.estimation.problem import Problem
from twin_daemon.estimation.solvers.trust_region import Derivative, descend, differenced
from twin_daemon.estimation.subproblems import reduced_problems
from twin_daemon.estimation.thresholds import DESCENT_ITERATIONS, DESCENT_ROUNDS, STALLED
from twin_daemon.estimation.windows import excerpts
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_joint_map, load_recording
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.alignment import Aligned, align, moving_joints
from twin_daemon.simulation.submodel import parts
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.workflows.session import silence_mujoco

_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
_CLOSE = 1.02  # times the best end of all: there a descent counts as arrived
_WORN = {
    "rh_FFJ0.kp": 0.6,
    "rh_FFJ3.kp": 1.3,
    "rh_FFJ3.damping": 2.0,
    "rh_FFJ2.damping": 1.6,
    "rh_FFJ3.frictionloss": 1.7,
    "rh_FFJ1.frictionloss": 0.6,
}
_GAP = EffectTerm(effect="backlash", target="rh_FFJ3", values={"gap": 0.03})

Part = tuple[Problem, list[int]]
"""A problem, and its columns whose derivatives are taken anew at every point: those of an effect."""


class Counted:
    """A problem that keeps the cost of every point that it was asked for."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.variables, self.start = problem.variables, problem.start
        self.costs: list[float] = []

    def residuals(self, points: np.ndarray) -> np.ndarray:
        """(B, m) residuals of points (B, p)."""
        rows = self.problem.residuals(np.clip(points, 0.0, 1.0))
        self.costs += (rows**2).sum(axis=1).tolist()
        return rows


def by_trust_region(problem: Counted, own: Sequence[int]) -> None:
    """Ours: derivatives by the variables in `own` anew at each point, the others kept up to date (Broyden)."""
    point, rows, cost, left = problem.start, None, np.inf, int(DESCENT_ITERATIONS)
    for _ in range(DESCENT_ROUNDS):
        found = descend(problem, point, Derivative(problem, own), evaluations=left, begun=rows)
        point, rows, before, cost = found.point, found.rows, cost, float(found.rows @ found.rows)
        left -= found.spent
        if left <= 0 or cost > (1.0 - STALLED) * before:
            break


def by_minimize(problem: Counted) -> None:
    """mujoco.minimize: Levenberg-Marquardt in a box."""
    minimize.least_squares(
        problem.start,
        lambda columns: problem.residuals(np.atleast_2d(columns.T)).T,
        bounds=[np.zeros(len(problem.start)), np.ones(len(problem.start))],
        eps=1e-3,
        mu_factor=4.0,
        max_iter=40,
        xtol=1e-5,
        gtol=1e-10,
        verbose=minimize.Verbosity.SILENT,
    )


def by_scipy(problem: Counted, method: str) -> None:
    """scipy.optimize.least_squares with bounds and a callable Jacobian."""
    last: dict[bytes, np.ndarray] = {}

    def residuals(point: np.ndarray) -> np.ndarray:
        last.clear()
        last[point.tobytes()] = problem.residuals(point[None])[0]
        return last[point.tobytes()]

    def jacobian(point: np.ndarray) -> np.ndarray:
        rows = last.get(point.tobytes())
        rows = problem.residuals(point[None])[0] if rows is None else rows
        return differenced(problem, point, rows, range(len(point)))

    start = np.clip(problem.start, 1e-6, 1.0 - 1e-6)  # it wants a start within its bounds
    options: dict[str, Any] = {"x_scale": "jac", "ftol": 2e-4, "xtol": 1e-5, "max_nfev": 40}
    optimize.least_squares(
        residuals, start, jac=cast(Any, jacobian), bounds=(0.0, 1.0), method=cast(Any, method), **options
    )


METHODS: dict[str, Callable[[Counted, Sequence[int]], None]] = {
    "trust region, Broyden": by_trust_region,
    "trust region, Jacobian at each point": lambda problem, own: by_trust_region(problem, range(len(problem.start))),
    "mujoco.minimize": lambda problem, own: by_minimize(problem),
    "scipy trf": lambda problem, own: by_scipy(problem, "trf"),
    "scipy dogbox": lambda problem, own: by_scipy(problem, "dogbox"),
}


# -- problems ------------------------------------------------------------------------------------------------


def _finger(terms: Terms, twin: TwinModel) -> Aligned:
    return align(twin, recorded(twin.changed(terms), FINGER, np.random.default_rng(5)))


def _calibration(twin: TwinModel, aligned: Aligned, space: str) -> list[Part]:
    """What `twin calibrate` descends, part by part."""
    known, moving = load_space(space), moving_joints([aligned])
    variables, joints = variables_of(known, twin, moving), objective_of(known, twin, moving)
    found = reduced_problems(twin, excerpts([aligned]), variables, joints, separable=True, free_onsets=True)
    return [(sub.problem, []) for sub in found]


def _part_fit(twin: TwinModel, aligned: Aligned, name: str | None) -> PartFit:
    reduction = Reduction(twin, [aligned], [])
    part = next(p for p in parts(twin) if name in (None, p.name))
    reduced = reduction.of(twin, part, [joint for joint in part.joints if joint in reduction.moving])
    assert reduced is not None  # the recordings below are clear of contacts
    return PartFit(reduced.twin, reduced.train, reduced.joints)


def finger_calibration() -> list[Part]:
    """The physical values of a finger, six of them up to twice off."""
    twin = TwinModel.load(load_hand())
    values = {name: factor * twin.parameter(name).read(twin.model) for name, factor in _WORN.items()}
    return _calibration(twin, _finger(Terms(parameters=values), twin), "physical")


def finger_with_effect() -> list[Part]:
    """A finger with play: the gap, and all that is uncertain beside it, as a diagnosis fits them."""
    twin = TwinModel.load(load_hand())
    part = _part_fit(twin, _finger(Terms(effects=(_GAP,)), twin), "FF")
    asked = next(h for h in hypotheses(part.twin, part.joints, whole_hand=False) if h.name == "backlash:rh_FFJ3")
    problem = part.problem_with((asked, asked.starts[0]))
    return [(problem, own_columns(problem))]


def whole_hand() -> list[Part]:
    """The real hand as it closes, in the physical space: all its parts."""
    folder = _DATA / "shadow_hand_real"
    if not folder.is_dir():
        raise LeftOut("the measured recordings (../shared/data) are not on this machine")
    hand = load_hand()
    twin = TwinModel.load(hand)
    trajectory = load_trajectory(f"{folder / 'trajectories.yaml'}:hand_closing", hand)
    return _calibration(twin, align(twin, load_recording(folder / "hand_closing.csv"), trajectory), "physical")


def arm() -> list[Part]:
    """What is uncertain about a real SO-101 arm, from its `multisine`, as a diagnosis fits it first."""
    folder = _DATA / "so101_real"
    if not folder.is_dir():
        raise LeftOut("the measured recordings (../shared/data) are not on this machine")
    twin = TwinModel.load(load_hand(model=folder / "so101.xml"))
    recording = load_recording(folder / "multisine", joint_map=load_joint_map(folder / "joint_map.yaml"))
    return [(_part_fit(twin, align(twin, recording), None).problem, [])]


PROBLEMS: dict[str, Callable[[], list[Part]]] = {
    "finger-calibration": finger_calibration,
    "finger-with-effect": finger_with_effect,
    "whole-hand": whole_hand,
    "arm": arm,
}


def main() -> None:
    """A table: roll-outs of each descent to its end, that end over the best of all, roll-outs to within 2 % of that."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="+", choices=PROBLEMS, default=list(PROBLEMS), metavar="NAME")
    chosen = parser.parse_args()
    silence_mujoco()
    print("| problem | descent | roll-outs | end over the best | roll-outs to within 2 % of the best | processor s |")
    print("|---|---|---|---|---|---|")
    for name in chosen.only:
        try:
            given = PROBLEMS[name]()
        except LeftOut as why:
            print(f"| {name} | left out: {why} | | | | |")
            continue
        traces, took = {}, {}
        for method, run in METHODS.items():
            began = time.process_time()
            traces[method] = [_trace(run, *one) for one in given]
            took[method] = time.process_time() - began
        best = [min(trace[-1] for trace in each) for each in zip(*traces.values(), strict=True)]
        variables = sum(len(problem.variables) for problem, _ in given)
        for method, found in traces.items():
            near = [trace <= _CLOSE * end for trace, end in zip(found, best, strict=True)]
            arrived = [int(np.argmax(one)) + 1 for one in near if one[-1]]
            told = f"{sum(arrived)}" if len(arrived) == len(near) else f"{len(arrived)} of {len(near)} parts arrive"
            ends = sum(trace[-1] for trace in found) / sum(best)
            print(
                f"| {name}: {len(given)} part{'s' * (len(given) > 1)}, {variables} variables | {method} "
                f"| {sum(map(len, found))} | {ends:.3f} | {told} | {took[method]:.1f} |",
                flush=True,
            )


def _trace(run: Callable[[Counted, Sequence[int]], None], problem: Problem, own: Sequence[int]) -> np.ndarray:
    """(n,) the lowest cost after each roll-out of a descent."""
    counted = Counted(problem)
    with threadpool_limits(limits=1):
        run(counted, own)
    return np.minimum.accumulate(counted.costs)


if __name__ == "__main__":
    main()
