"""Runs a diagnosis over a folder of exported cases and says which verdicts are right. One file, nothing but Python.

    python score.py DIR [TWIN]        # TWIN: path of the command, `twin` if it is not given

Calls `TWIN diagnose --model ... --recording ... --holdout ... --json ...` for each case that has no result yet. To
score a method of your own, write `<case>.json` with `verdict` and `findings` for each case instead.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

NAMED = ("explained", "ambiguous")
CERTAIN = 3.0  # floors from which on an answer may be asked for


def outcome(truth: dict[str, Any], said: dict[str, Any]) -> dict[str, bool]:
    """`right`: as the kind of the case asks; `sure_and_wrong`: explained with a name that is not the hidden one's."""
    verdict, findings, kind = said["verdict"], said["findings"], truth["kind"]
    hidden = truth["effects"]
    matched = [next((f for f in findings if same(f, one)), None) for one in hidden]
    if kind == "nothing":
        right = verdict == "within_noise"
    elif kind == "foreign":
        right = verdict == "unexplained" or (verdict in NAMED and composes(said, truth))
    elif kind == "pair":
        right = verdict in NAMED and all(found is not None for found in matched)
    else:
        right = bool(findings) and verdict in NAMED and (same(findings[0], hidden[0]) or tied(findings[0], said, truth))
        if hidden[0]["scope"] == "robot":  # once, for the robot
            right = right and sum(found["effect"] == hidden[0]["effect"] for found in findings) == 1
    wrong = verdict == "explained" and bool(findings) and not right
    if kind == "pair" and wrong:
        wrong = not all(any(same(found, one) for one in hidden) for found in findings)
    return {"right": right, "sure_and_wrong": wrong}


def same(found: dict[str, Any], one: dict[str, Any]) -> bool:
    """Whether a finding is a hidden effect at its place; one of the robot has to be found at (nearly) all joints."""
    if found["effect"] != one["effect"]:
        return False
    common = set(found["joints"]) & set(one["joints"])
    if one["scope"] == "robot":
        whole = one["effect"] == "gravity_tilt" or len(common) >= 0.8 * len(one["joints"])
        return not found["joints"] or (whole and bool(common))
    return bool(common)


def is_cause(effects: list[str], truth: dict[str, Any]) -> bool:
    """Whether a set of causes, each `effect:place`, is what is hidden.

    A place is a joint, or the command of a tendon for the two joints that it moves. A cause of the whole robot is at
    `robot` or `hand`, or at a place that is all of the robot. What these data are too weak to show is an effect below
    three floors.
    """
    hidden, kind = truth["effects"], truth["kind"]
    if list(effects) == ["too_weak"]:
        return any(one["strength"] < CERTAIN for one in hidden)
    if kind in ("nothing", "foreign"):
        if list(effects) == ["nothing" if kind == "nothing" else "unknown"]:
            return True
        named = [name.partition(":")[0] for name in effects]
        wanted = truth.get("composed", [])
        return bool(wanted) and len(named) == len(wanted) and all(set(names) & set(named) for names in wanted)
    said = [tuple(name.partition(":")[::2]) for name in effects]
    if len(said) != len(hidden):
        return False
    return all(any(key == one["effect"] and _is_at(place, one) for key, place in said) for one in hidden)


def _is_at(place: str, one: dict[str, Any]) -> bool:
    meant = [place, place[:-1] + "1", place[:-1] + "2"] if place.endswith("J0") else [place]
    if one["scope"] == "robot":
        return place in ("robot", "hand") or set(one["joints"]) <= set(meant)
    return any(name in one["joints"] for name in meant)


def composes(said: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether the findings are the effects that together are the hidden law, each once, and nothing else."""
    wanted, found = truth.get("composed", []), said["findings"]
    here = all(set(one["joints"]) & set(truth["joints"]) for one in found)
    each = [next((one for one in found if one["effect"] in names), None) for names in wanted]
    return bool(wanted) and here and len(found) == len(wanted) and all(one is not None for one in each)


def tied(found: dict[str, Any], said: dict[str, Any], truth: dict[str, Any]) -> bool:
    """Whether an `ambiguous` answer names the hidden effect beside nothing but what cannot be told from it."""
    one = truth["effects"][0]
    names = {found["effect"], *(name.split(":")[0] for name in found.get("confusable_with", []))}
    here = bool(set(found["joints"]) & set(one["joints"]))
    return said["verdict"] == "ambiguous" and here and one["effect"] in names and names <= set(truth["right"])


def main() -> int:
    """Prints a line for each case and the rates by kind."""
    folder, twin = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "twin"
    totals: dict[str, list[int]] = {}
    for path in sorted(folder.glob("*.truth.json")):
        truth = json.loads(path.read_text())
        name, began = truth["case"], time.monotonic()
        result = folder / f"{name}.json"
        if not result.exists():
            fit, held = (str(folder / f"{name}_{kind}") for kind in ("fit", "holdout"))
            command = [twin, "diagnose", "--model", str(folder / truth["model"]), "--recording", fit, "--holdout", held,
                       "--json", str(result)]  # fmt: skip
            ran = subprocess.run(command, capture_output=True, text=True, check=False)
            if not result.exists():
                print(f"{name} FAILED {ran.returncode} {ran.stderr.strip()[-150:]}")
        said = json.loads(result.read_text()) if result.exists() else {"verdict": "failed", "findings": []}
        scored = outcome(truth, said)
        row = totals.setdefault(truth["kind"], [0, 0, 0])
        for index, value in enumerate((scored["right"], scored["sure_and_wrong"], True)):
            row[index] += value
        named = ", ".join(f"{f['effect']}:{(f['joints'] or ['robot'])[0]}" for f in said["findings"][:3])
        hidden = ", ".join(f"{one['effect']}:{one['joints'][0]} ({one['strength']:.1f})" for one in truth["effects"])
        mark, took = "ok " if scored["right"] else "BAD", time.monotonic() - began
        print(f"{name} {mark} {said['verdict']:13s} {named or '-'} <- {hidden or 'nothing'} ({took:.0f} s)", flush=True)
    for kind, (right, wrong, count) in totals.items():
        print(f"{kind}: {right} of {count} right, {wrong} explained with a wrong name")
    return 0


if __name__ == "__main__":
    sys.exit(main())
