"""Practice cases with a recording of the healthy hand beside them, made with MuJoCo alone, and their score.

    python -m bench.healthy_cases make OUT --model right_hand.xml --seed 3
    python -m bench.healthy_cases score OUT

A case is OUT/<case>_healthy, <case>_fit and <case>_holdout (ROS 2 bags) and <case>.truth.json. Its plant is a Shadow
Hand whose damping, dry friction and gains are up to 20 % off the model and a percent off between sessions; the effect
is hidden in `_fit` and `_holdout` only. A case is right when the planted effect stands first at its joint with
`explained` or `ambiguous`, or `ambiguous` with both where sessions cannot tell two; with nothing hidden only
`within_noise` is.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np

from bench.changes_cases import BETWEEN_SESSIONS, FINGERS, SPREAD, Plant, plant_of, record
from twin_daemon.cli.app import main as twin

SECONDS = {"healthy": 30.0, "fit": 30.0, "holdout": 20.0}
CASES: dict[str, tuple[str, ...]] = {
    "hand_nothing": (),
    "hand_sensor_offset": ("sensor_offset",),
    "hand_weak_servo": ("actuator_gain", "tendon_elasticity"),
    "hand_viscous": ("viscous_friction",),
    "hand_coulomb": ("coulomb_friction",),
    "hand_load_friction": ("load_friction",),
    "hand_backlash": ("backlash",),
    "hand_slack_tendon": ("tendon_elasticity", "actuator_gain"),
    "hand_payload": ("payload",),
    "hand_cubic_spring": ("nonlinear_spring",),
    "hand_sensor_gain": ("sensor_gain", "spring"),
}
"""The effect that is hidden, and one that these data may call as likely."""


def make(folder: Path, model: Path, name: str, seed: int) -> None:
    """Writes a case's recordings and what was hidden. The same seed makes the same case."""
    rng = np.random.default_rng([seed, list(CASES).index(name), 19])
    joint, strength = f"rh_{rng.choice(FINGERS)}J3", float(rng.uniform(0.6, 1.6))
    body = rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, (3, 64))
    for week, (tag, seconds) in enumerate(SECONDS.items()):
        plant = plant_of(model, joint, body * rng.normal(1.0, BETWEEN_SESSIONS, (3, 64)))
        if tag != "healthy":
            _hide(plant, name, strength)
        record(plant, folder / f"{name}_{tag}", week, int(rng.integers(1 << 30)), seconds, rng)
    right = list(CASES[name])
    carrying = (3, 2, 1) if name == "hand_payload" else (3,)
    truth = {
        "case": name,
        "model": str(model),
        "right": right,
        "joints": [joint.replace("J3", f"J{number}") for number in carrying] if right else [],
        "strength": strength,
    }
    (folder / f"{name}.truth.json").write_text(json.dumps(truth))


def _hide(plant: Plant, name: str, strength: float) -> None:
    """Hides a case's effect in a plant."""
    m, dof, servo = plant.model, int(plant.model.jnt_dofadr[plant.joint]), plant.actuator
    if name == "hand_weak_servo":
        left = 0.7 - 0.25 * (strength - 1.0)
        m.actuator_gainprm[servo, 0] *= left
        m.actuator_biasprm[servo, 1] *= left
    if name == "hand_viscous":
        m.dof_damping[dof] *= 1.0 + 0.6 * strength
    if name == "hand_coulomb":
        m.dof_frictionloss[dof] *= 1.0 + 1.5 * strength
    if name == "hand_load_friction":
        plant.load_friction = 0.25 * strength
    if name == "hand_backlash":
        plant.gap_rad = 0.03 * strength
    if name == "hand_slack_tendon":
        plant.tendon = 2.5 / strength * float(m.actuator_gainprm[servo, 0])
    if name == "hand_payload":
        finger = m.joint(plant.joint).name[3:5].lower()
        m.body_mass[m.body(f"rh_{finger}distal").id] += 0.1 * strength
    if name == "hand_cubic_spring":
        plant.cubic = 0.45 * strength
    if name == "hand_sensor_gain":
        plant.gain = 1.0 - 0.1 * strength
    if name == "hand_sensor_offset":
        plant.offset_rad = 0.05 * strength


def score(folder: Path) -> None:
    """Diagnoses every case beside its healthy recording and says which are right."""
    good = sure = 0
    truths = sorted(folder.glob("*.truth.json"))
    for path in truths:
        case = json.loads(path.read_text())
        bags = {tag: str(folder / f"{case['case']}_{tag}") for tag in SECONDS}
        answer, began = folder / f"{case['case']}.json", time.process_time()
        given = ["--recording", bags["fit"], "--holdout", bags["holdout"], "--baseline", bags["healthy"]]
        if not answer.exists() and twin(["diagnose", "--model", case["model"], *given, "--json", str(answer)]):
            raise SystemExit(f"{path}: not diagnosed")
        found = json.loads(answer.read_text())
        right = is_right(found, case["right"], case["joints"])
        good, sure = good + right, sure + (found["verdict"] == "explained" and not right)
        told = [(one["effect"], one["joints"]) for one in found["findings"][:3]]
        print(f"{case['case']:20} {'ok ' if right else 'BAD'} {found['verdict']:13} {told}", end=" ")
        print(f"{time.process_time() - began:.0f} s", flush=True)
    print(f"{good} of {len(truths)} right, {sure} explained with a wrong name")


def is_right(found: dict, right: list[str], joints: list[str]) -> bool:
    """Whether a verdict is right about what was hidden: `right` begins with the effect, at one of `joints`."""
    if not right:
        return found["verdict"] == "within_noise"
    first = next(iter(found["findings"]), None)
    if first is None or not set(first["joints"]) & set(joints):
        return False
    if first["effect"] == right[0]:
        return found["verdict"] in ("explained", "ambiguous")
    named = {first["effect"], *(rival.partition(":")[0] for rival in first["confusable_with"])}
    return found["verdict"] == "ambiguous" and right[0] in named and named <= set(right)


def main() -> None:
    """Makes the cases, or scores those of a folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("what", choices=("make", "score"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--model", type=Path, help="the third-party Shadow Hand's MJCF")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cases", nargs="*", choices=list(CASES), default=list(CASES))
    given = parser.parse_args()
    if given.what == "score":
        score(given.folder)
        return
    if given.model is None:
        parser.error("make needs --model")
    given.folder.mkdir(parents=True, exist_ok=True)
    for name in given.cases:
        make(given.folder, given.model, name, given.seed)


if __name__ == "__main__":
    main()
