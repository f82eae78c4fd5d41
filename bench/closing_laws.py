"""What the real hand's closing leaves after the four couplings, and whether any law of one variable is behind it.

    python -m bench.closing_laws [--joints rh_FFJ2 rh_FFJ3 ...]

Begins with the version `real_closing`. Every port and variable of `twin propose` is fitted to one half of the motion,
with all that is uncertain anyway, and judged on the other half: closing on opening, and opening on closing. What stands
for a cause has to hold both ways.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from bench.frame import LeftOut
from bench.machine import in_words, provenance
from bench.real import calibrated_closing
from twin_daemon.comparison.split import masked
from twin_daemon.estimation.partition import Reduction
from twin_daemon.proposals.descent import Reached
from twin_daemon.proposals.search import JointSearch, Trial
from twin_daemon.proposals.thresholds import RACING
from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.twin import TwinModel

JOINTS = ("rh_FFJ2", "rh_MFJ2", "rh_RFJ2", "rh_LFJ2", "rh_RFJ3")
START_S, TURN_S = 0.4, 0.4  # what counts as the start, and as the reversal to either side


@dataclass(frozen=True)
class Held:
    """A law fitted to one half: the share of the error that it takes from that half and from the other (95 %)."""

    law: str
    fitted: float
    held: float
    low: float
    high: float


def halves(recording: Aligned, turn_s: float) -> tuple[Aligned, Aligned]:
    """(the motion before a time, the motion after it), each with the other hidden."""
    late = recording.time_s >= turn_s
    return masked(recording, late), masked(recording, ~late)


def laws(twin: TwinModel, train: Aligned, held: Aligned, joint: str) -> tuple[float, list[Held]]:
    """(what the model leaves of the half it is fitted to, in floors; the laws that promise most, the best first)."""
    part = next(group for group in drive_groups(twin) if joint in group.joints)
    search = JointSearch(twin, Reduction(twin, [train], [held]), part, joint, [train], [held])
    trials = search.trials()
    best: dict[str, Held] = {}
    for trial in trials:
        if trial.feature.name not in best and len(best) < RACING:
            best[trial.feature.name] = _one_step(search, trial)
    for law in search.leading(trials):
        taken = 1.0 - law.reached.cost / search.alone.cost
        best[law.feature.name] = Held(law.feature.name, taken, law.gain, *law.gain_ci95)
    return search.times_floor, sorted(best.values(), key=lambda one: -one.fitted)


def _one_step(search: JointSearch, trial: Trial) -> Held:
    problem = search.problem(trial.feature, trial.smoothness)
    reached = Reached(trial.start, problem.residuals(trial.start[None])[0], np.zeros((0, 0)))
    judged = search.judged(trial, problem, reached, freedom=trial.freedom)
    return Held(trial.feature.name, trial.reduction, judged.gain, *judged.gain_ci95)


def where_it_is(twin: TwinModel, recording: Aligned, joints: list[str], turn_s: float) -> list[str]:
    """Rows of a table: rms in mrad by joint over all, and shares of the squared error at the start and the reversal."""
    squared = (predict(twin, recording) - recording.measured) ** 2
    start = recording.time_s < START_S
    turn = np.abs(recording.time_s - turn_s) < TURN_S
    rows = []
    for joint in joints:
        own = squared[:, recording.joints.index(joint)]
        total = float(np.nansum(own))
        shares = [float(np.nansum(own[where])) / total for where in (start, turn, ~(start | turn))]
        said = " | ".join(f"{share:.0%}" for share in shares)
        rows.append(f"| {joint} | {1e3 * float(np.sqrt(np.nanmean(own))):.1f} | {said} |")
    return rows


def alike(recording: Aligned, joint: str, turn_s: float) -> str:
    """How far, by rank, a joint's angle goes with the time and with its finger's other angles while it closes."""
    before = recording.time_s < turn_s
    finger = [name for name in recording.joints if name[:-1] == joint[:-1] and name != joint and name[-1] in "123"]
    others = {"the time": recording.time_s} | {n: recording.states[:, recording.joints.index(n)] for n in finger}
    own = recording.states[before, recording.joints.index(joint)]
    said = [f"{name} {spearmanr(own, other[before])[0]:.3f}" for name, other in others.items()]
    return f"{joint} goes with {', '.join(said)}"


def main() -> None:
    """Prints the tables as they are measured."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--joints", nargs="+", default=list(JOINTS))
    given = options.parse_args()
    try:
        twin, recording = calibrated_closing()
    except LeftOut as why:
        print(why)
        return
    turn_s = 0.5 * float(recording.time_s[-1])
    first, second = halves(recording, turn_s)
    print("| joint | rms, mrad | of the squared error: start | reversal | between |\n|---|---|---|---|---|")
    print("\n".join(where_it_is(twin, recording, given.joints, turn_s)), flush=True)
    print("\n".join(alike(recording, joint, turn_s) for joint in given.joints), flush=True)
    print("\n| joint | fitted to | floors | law | of that half | of the other (95 %) |\n|---|---|---|---|---|---|")
    for joint in given.joints:
        for name, train, held in (("closing", first, second), ("opening", second, first)):
            floors, found = laws(twin, train, held, joint)
            for one in found:
                share = f"{one.held:.0%} ({one.low:.0%} to {one.high:.0%})"
                print(f"| {joint} | {name} | {floors:.0f} | {one.law} | {one.fitted:.0%} | {share} |", flush=True)
    print(in_words(provenance("python -m bench.closing_laws")))


if __name__ == "__main__":
    main()
