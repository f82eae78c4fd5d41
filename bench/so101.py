"""A real arm, fitted on five motions of its eleven that `twin check` would choose, judged on the six others.

    python -m bench.so101 [--values | --seconds 400 --joints elbow_flex ...] [--choose]

With `--values` the values of the physical space are fitted and nothing else. Otherwise each joint is diagnosed alone,
every motion held out in turn, and what is found is added as it is. Free roll-outs of the six others are compared with
the nominal model's: error against nominal by motion, the worst joint, and what of the motion is outside of the region
of the five. `--choose` computes the choice anew (some 80 s of processor time).
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from bench.frame import LeftOut
from twin_daemon.calibration.calibrate import calibrate
from twin_daemon.calibration.motion_choice import information_of, most_informative
from twin_daemon.calibration.spaces import load_space
from twin_daemon.comparison.compare import compare_recording, mean_over_moving
from twin_daemon.comparison.region import outside, region_of
from twin_daemon.diagnosis.free_rollout import with_finding
from twin_daemon.diagnosis.search import diagnose
from twin_daemon.hand import load_hand
from twin_daemon.processor_time import TimeLimit
from twin_daemon.recordings import load_joint_map, load_recording
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.workflows.session import silence_mujoco

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "so101_real"
LOADED = ("elbow_flex", "shoulder_lift", "wrist_flex")  # that gravity pulls at
FIVE = ("multisine", "random_waypoints", "friction_gravity", "large_amplitude", "static_holding")
"""The first five of the choice, as it came out on 23 November 2026."""


def arm() -> tuple[TwinModel, dict[str, Aligned]]:
    """(the nominal twin, its recordings by motion)."""
    if not DATA.is_dir():
        raise LeftOut("the measured recordings (../shared/data) are not on this machine")
    twin, names = TwinModel.load(load_hand(model=DATA / "so101.xml")), load_joint_map(DATA / "joint_map.yaml")
    motions = sorted(path for path in DATA.iterdir() if path.is_dir())
    return twin, {path.name: align(twin, load_recording(path, names)) for path in motions}


def chosen(twin: TwinModel, motions: dict[str, Aligned]) -> tuple[str, ...]:
    """The five motions that say most, each with what it adds."""
    said = information_of(twin, list(motions.values()), load_space("physical"))
    order = most_informative(list(motions), said)
    for one in order:
        print(f"{one.name:20s} adds {one.gain_nats:6.1f} nats, {one.share:.0%} so far")
    return tuple(one.name for one in order[:5])


def fitted(twin: TwinModel, train: list[Aligned], joints: list[str], seconds: float) -> TwinModel:
    """The twin with what a diagnosis of each joint finds."""
    changed = twin
    for joint in joints:
        began = time.process_time()
        found = diagnose(twin, train, train, joints=[joint], limit=TimeLimit(wall_s=seconds), stream=print)
        print(f"{joint}: {found.verdict}, {found.reason} ({time.process_time() - began:.0f} s of processor time)")
        for finding in found.findings:
            values = ", ".join(f"{name} {one.value:.3g}" for name, one in finding.parameters.items())
            worst = max(finding.holdout_motions, key=lambda motion: motion.left)
            print(f"  {finding.name}: {values}; worst in turn {worst.name}, {worst.left:.1f} times what may be left")
            print(f"  not told apart from {', '.join(finding.confusable_with) or 'anything'}")
            changed = with_finding(changed, finding)
    return changed


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seconds", type=float, default=400.0, help="at most for each joint")
    parser.add_argument("--joints", nargs="+", default=list(LOADED))
    parser.add_argument("--choose", action="store_true")
    parser.add_argument("--values", action="store_true")
    given = parser.parse_args()
    silence_mujoco()
    twin, motions = arm()
    five = chosen(twin, motions) if given.choose else FIVE
    train = [motions[name] for name in five]
    if given.values:
        changed = twin.changed(calibrate(twin, train, [], load_space("physical"), "least-squares").terms)
    else:
        changed = fitted(twin, train, given.joints, given.seconds)
    region = region_of(changed, train)
    assert region is not None
    for name, motion in motions.items():
        if name in five:
            continue
        before, after = (compare_recording(one, motion).joints for one in (twin, changed))
        old, new = mean_over_moving(before), mean_over_moving(after)
        moving = [joint for joint, error in after.items() if error.moves]
        worst = max(moving, key=lambda joint: after[joint].rmse_rad)
        ratio = f"{new / old:.2f}" if old and new is not None else "-"
        print(f"{name:20s} {ratio} of nominal; worst {worst}, {1e3 * after[worst].rmse_rad:.1f} mrad")
        for one in outside(changed, region, [motion]):
            print(f"  outside: {one}")


if __name__ == "__main__":
    main()
