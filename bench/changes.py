"""Plants a change between two sessions, asks `twin diagnose --baseline` for it, and counts right and wrong names.

    python -m bench.changes --model right_hand.xml --folder /tmp/changes --seeds 1 2 3

By default only the finger that has changed and its neighbour are looked at, which costs a fifth of the whole hand.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from bench.changes_cases import CHANGES, FINGERS, Case, make
from twin_daemon.cli.app import main as twin

ALIKE = {"tendon_elasticity": {"actuator_gain"}, "actuator_gain": {"tendon_elasticity"}}
"""What data of one session cannot tell from a change, so that `ambiguous` with both is right."""


def main() -> None:
    """Makes the cases that are not there yet, diagnoses them, and prints a line for each and the rates."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--model", type=Path, required=True, help="the third-party Shadow Hand's MJCF")
    parser.add_argument("--folder", type=Path, required=True, help="recordings and answers")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1])
    parser.add_argument("--changes", nargs="+", choices=list(CHANGES), default=list(CHANGES))
    parser.add_argument("--whole", action="store_true", help="look at every joint that moves")
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    told: list[str] = []
    for seed in given.seeds:
        for change in given.changes:
            told.append(_one(given.folder, given.model, change, seed, given.whole))
    for word in ("right", "silent", "wrong"):
        print(f"{word}: {told.count(word)} of {len(told)}")


def _one(folder: Path, model: Path, change: str, seed: int, whole: bool) -> str:
    truth, answer = folder / f"{change}_{seed}.truth.json", folder / f"{change}_{seed}.json"
    if not truth.exists():
        make(folder, model, change, seed)
    case = Case.read(folder, f"{change}_{seed}")
    began = time.process_time()
    if not answer.exists():
        joints = [] if whole else ["--joints", case.joint, _neighbour(case.joint)]
        bags = ["--recording", str(case.recording), "--baseline", str(case.baseline)]
        code = twin(["diagnose", "--model", str(model), *bags, *joints, "--json", str(answer)])
        if code:
            raise SystemExit(code)
    found = json.loads(answer.read_text())
    word = judged(found, case)
    named = [(f["effect"], f["joints"], f["ratio"]["value"], f["probability"]) for f in found["changes"]]
    print(
        f"{case.name:12} {case.joint} {word:6} {found['verdict']:13} {time.process_time() - began:4.0f} s {named}",
        flush=True,
    )
    return word


def judged(found: dict[str, Any], case: Case) -> str:
    """right, silent (a planted change is not named), or wrong (another name or another place)."""
    changes: Sequence[dict[str, Any]] = found["changes"]
    if case.effect is None or not changes:
        return "wrong" if changes else "silent" if case.effect else "right"
    first = changes[0]
    other = {rival.partition(":")[0] for rival in first["rivals"]} if found["verdict"] == "ambiguous" else set()
    alike = first["effect"] in ALIKE.get(case.effect, ()) and case.effect in other
    return "right" if (first["effect"] == case.effect or alike) and case.joint in first["joints"] else "wrong"


def _neighbour(joint: str) -> str:
    """The same joint of the next finger."""
    finger = joint.removeprefix("rh_")[:2]
    return joint.replace(finger, FINGERS[(FINGERS.index(finger) + 1) % len(FINGERS)])


if __name__ == "__main__":
    main()
