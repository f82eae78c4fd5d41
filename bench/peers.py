"""Other people's fits and searches on what `twin calibrate` fits: one recording, parameters, bounds and start."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.frame import LeftOut, Row, ratio_row
from bench.objective import Objective, Search, gaussian_process
from bench.real import real
from bench.sysid_peer import SysidRun, run_sysid
from twin_daemon.calibration.calibrate import Calibration, calibrate
from twin_daemon.calibration.spaces import load_space
from twin_daemon.comparison.split import hold_out
from twin_daemon.estimation.solvers.tracker import Tracker

_GP_CALLS = 60


@dataclass(frozen=True)
class _Ours:
    """A run of `twin calibrate`, and when its search's own error first came below which."""

    fit: Calibration
    falls: list[tuple[float, float]]

    def reached_s(self, error_rad2: float) -> float | None:
        """When it came to an error; None if never. The search's own is scaled to what its best is judged at."""
        judged = self.fit.after_rad2 / min(error for _, error in self.falls)
        return next((time_s for time_s, error in self.falls if error * judged <= error_rad2), None)


def _ours(objective: Objective, space: str, seed: int) -> _Ours:
    began, falls = time.monotonic(), []

    def progress(count: int, error: float) -> None:
        falls.append((time.monotonic() - began, error))

    fit = calibrate(
        objective.nominal,
        objective.train,
        objective.held,
        load_space(space),
        "least-squares",
        seed=seed,
        progress=progress,
    )
    return _Ours(fit, falls)


def _closing(space: str) -> Objective:
    twin, aligned = real("hand_closing")
    train, held = hold_out([aligned])
    return Objective(twin, train, held, load_space(space))


def sysid(quick: bool, seed: int) -> Sequence[Row]:
    """mujoco.sysid with its default settings and tuned, each in turn with `twin calibrate`."""
    space, rounds, iterations = "second-approach", 1 if quick else 2, 3 if quick else 200
    objective = _closing(space)
    ours: list[_Ours] = []
    theirs: dict[bool, list[SysidRun]] = {False: [], True: []}
    for number in range(rounds):
        ours.append(_ours(objective, space, seed + number))
        for tuned in theirs:
            theirs[tuned].append(run_sysid(objective, tuned=tuned, most_iterations=iterations))
    rows = []
    for tuned, runs in theirs.items():
        label = "tuned" if tuned else "default settings"
        told = f"{runs[0].unbounded} of its {runs[0].intervals} intervals are infinite; {runs[0].roll_outs} roll-outs"
        rows.append(ratio_row(f"{label}: error fitted", [o.fit.after_rad2 for o in ours],
                              [r.after_rad2 for r in runs], unit="rad²", most=1.0, note=told))  # fmt: skip
        held = [r.held_rad2 or np.nan for r in runs]
        rows.append(ratio_row(f"{label}: held out", [o.fit.holdout_after_rad2 or np.nan for o in ours], held,
                              unit="rad²", most=1.0))  # fmt: skip
        wall_s = [r.wall_s for r in runs]
        rows.append(ratio_row(f"{label}: time to the end", [o.fit.wall_s for o in ours], wall_s))
        what = f"{label}: time until its error is reached"
        reached = [o.reached_s(r.after_rad2) for o, r in zip(ours, runs, strict=True)]
        taken = [time_s for time_s in reached if time_s is not None]
        if len(taken) == len(runs):
            rows.append(ratio_row(what, taken, wall_s, most=0.5))
        else:
            missed = f"not reached in {len(runs) - len(taken)} of {len(runs)} rounds"
            rows.append(Row(what, None, float(np.median(wall_s)), goal="at most 0.5", met=False, note=missed))
    known = ours[0].fit.parameters.values()
    unsure = sum(p.identifiable != "identifiable" for p in known)
    bound = sum(p.at_bound for p in known)
    told = f"`twin calibrate` calls {unsure} of {len(known)} values weak or not identifiable, and {bound} on a bound"
    rows[0] = replace(rows[0], note=f"{rows[0].note}; {told}")
    return rows


def searches(quick: bool, seed: int) -> Sequence[Row]:
    """cma and scikit-optimize as searches, after as many roll-outs as least squares takes, or as they ask for."""
    objective = _closing("second-approach")
    ours = [_ours(objective, "second-approach", seed + i) for i in range(1 if quick else 2)]
    budget = 60 if quick else ours[0].fit.evaluations
    rows = []
    peers: tuple[tuple[str, Callable[[int], Search], int | None], ...] = (
        ("cma, default settings", lambda number: _cma(None, number), budget),
        ("cma, tuned", lambda number: _cma(30, number), 2 * budget),
        ("scikit-optimize", lambda number: gaussian_process(20 if quick else _GP_CALLS, 600.0, number), None),
    )
    for label, search, calls in peers:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the Gaussian process warns when a point comes up twice
            runs = [objective.run(search(seed + i), calls) for i in range(len(ours))]
        note = f"{len(runs[0].history)} roll-outs against {ours[0].fit.evaluations}"
        rows.append(ratio_row(f"{label}: error fitted", [o.fit.after_rad2 for o in ours],
                              [r.after_rad2 for r in runs], unit="rad²", most=1.0, note=note))  # fmt: skip
        rows.append(ratio_row(f"{label}: time", [o.fit.wall_s for o in ours], [r.wall_s for r in runs]))
    return rows


def _cma(population: int | None, seed: int) -> Search:
    def search(tracker: Tracker) -> None:
        try:
            import cma
        except ImportError:
            raise LeftOut("cma is not installed; it comes with the extra `bench`") from None

        options: dict[str, object] = {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9}
        if population:
            options["popsize"] = population
        strategy = cma.CMAEvolutionStrategy(tracker.problem.start, 0.3, options)
        while not strategy.stop():
            points = np.array(strategy.ask())
            strategy.tell(list(points), list(np.log(tracker.cost(points))))

    return search
