"""Can a kill -9 at any moment harm the version store? A child stores, promotes, goes back and prunes until it dies.

python -m bench.store_kill [--kills 1000] [--seed 1] [--folder DIR | --store DIR]

After each kill the store is verified from its files, every version whose storing returned must be there (or have been
pruned by a decision), and the names must be those of the last operation that returned or of the one that was cut off.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import select
import signal
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from twin_daemon.versions import NOMINAL, Draft, VersionStore
from twin_daemon.versions.prune import Policy, prune
from twin_daemon.versions.verify import verify

_MODEL = "<mujoco model='hand'/>" * 400
_POLICY = Policy(keep=6, older_than_days=0.0)
_LONGEST_WAIT_S = 60.0
_ROUND = 100  # kills of one store; the next one starts empty, or reading it all would take most of the time
_DECISION = {
    "add": "stored",
    "promote": "promoted",
    "rollback": "rolled_back",
    "prune": "pruned",
    "note": "noted",
}


@dataclass
class Expected:
    """What the operations that returned come to, and the one that had begun when the process was killed."""

    promoted: list[str] = field(default_factory=list)
    candidate: str | None = None
    stored: set[str] = field(default_factory=set)
    decisions: int = 0  # how many the log has
    begun: dict[str, Any] | None = None

    def returned(self, operation: dict[str, Any]) -> None:
        self.begun = None
        version = operation.get("version", "")
        match operation["what"]:
            case "add":
                self.stored.add(version)
                self.candidate = version if operation["named"] else self.candidate
            case "promote":
                if (NOMINAL, *self.promoted)[-1] != version:
                    self.promoted.append(version)
                self.candidate = None if self.candidate == version else self.candidate
            case "rollback":
                self.promoted.pop()
            case "prune":  # what lost its model cannot be gone back to
                gone = set(operation["gone"])
                self.promoted = [kept for kept in self.promoted if kept not in gone]

    def names(self) -> dict[str, str]:
        names: dict[str, str] = dict(zip(("current", "previous"), reversed((NOMINAL, *self.promoted)), strict=False))
        return names if self.candidate is None else {**names, "candidate": self.candidate}


@dataclass
class Outcome:
    """How many kills, what was cut off by them, how many operations had returned, and everything that was wrong."""

    kills: int = 0
    cut_off: Counter[str] = field(default_factory=Counter)
    returned: int = 0
    wrong: list[str] = field(default_factory=list)


def run(root: Path, kills: int, seed: int = 1) -> Outcome:
    """Kill so many writers of the store in `root`, one after another; each hundred has a store beside the last."""
    moments, outcome, expected = random.Random(seed), Outcome(), Expected()
    store, folder = VersionStore("hand", root=root, shipped=root / "none"), root
    for kill in range(kills):
        if kill and kill % _ROUND == 0:
            folder, expected = root.with_name(f"{root.name}-{kill // _ROUND}"), Expected()
            store = VersionStore("hand", root=folder, shipped=root / "none")
        _one(folder, kill, moments, expected, outcome)
        outcome.kills += 1
        outcome.wrong += [f"kill {kill}: {problem}" for problem in _judge(store, expected, outcome)]
        if outcome.kills % 100 == 0:
            print(f"{outcome.kills} kills, {outcome.returned} operations had returned", flush=True)
    return outcome


def _one(root: Path, kill: int, moments: random.Random, expected: Expected, outcome: Outcome) -> None:
    """Start a writer, let some operations return, kill it somewhere in the next."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reader)
        _work(root, kill, writer)
    os.close(writer)
    wanted, began, buffer = moments.randint(0, 5), time.monotonic(), b""
    pause_s = moments.uniform(0.0, 0.03)
    killed_at: float | None = None
    while True:
        if killed_at is None and wanted <= 0:
            killed_at = time.monotonic() + pause_s
        if (killed_at is not None and time.monotonic() >= killed_at) or time.monotonic() - began > _LONGEST_WAIT_S:
            break
        ready, _, _ = select.select([reader], [], [], 0.001)
        if ready:
            chunk = os.read(reader, 65536)
            if not chunk:
                outcome.wrong.append(f"the writer before kill {kill} ended by itself")
                break
            wanted -= chunk.count(b'"returned"')
            buffer = _heard(buffer + chunk, expected, outcome)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    while chunk := os.read(reader, 65536):
        buffer += chunk
    _heard(buffer, expected, outcome)
    os.close(reader)


def _heard(buffer: bytes, expected: Expected, outcome: Outcome) -> bytes:
    """Take in whole lines; the rest is returned."""
    *lines, rest = buffer.split(b"\n")
    for line in lines:
        said = json.loads(line)
        if said["when"] == "begun":
            expected.begun = said
        else:
            expected.returned(said)
            expected.decisions = said["decisions"]
            outcome.returned += 1
    return rest


def _judge(store: VersionStore, expected: Expected, outcome: Outcome) -> list[str]:
    outcome.cut_off[expected.begun["what"] if expected.begun else "nothing"] += 1
    found = verify(store)
    wrong = list(found.problems)
    there = {*found.intact, *found.pruned}
    wrong += [f"{version[:12]} was stored and is gone" for version in expected.stored - there]
    names, cut = store.aliases(), expected.begun
    before = expected.names()
    if cut is not None and _was_decided(store, cut, expected):
        expected.returned(cut)
    expected.begun, expected.decisions = None, len(store.decisions().decisions)
    if names != expected.names():
        wrong.append(f"the names are {names}, before {before}, expected {expected.names()} after {cut}")
    return wrong


def _was_decided(store: VersionStore, cut: dict[str, Any], expected: Expected) -> bool:
    """Whether the operation that was cut off has been done after all; completes what is known of it."""
    decisions = store.decisions().decisions[expected.decisions :]
    last = decisions[-1] if decisions else None
    if last is None or last.what != _DECISION[cut["what"]]:
        return False
    cut |= {"gone": [*last.removed, *last.stubbed], "version": last.version or "", "named": last.name is not None}
    return True


def _work(root: Path, kill: int, writer: int) -> None:
    """In the child: operations for ever, each announced before and after. Ends the process, whatever happens."""
    try:
        dice = random.Random(kill)
        store = VersionStore("hand", root=root, shipped=root / "none")
        number = 0
        while True:
            what = dice.choices(("add", "promote", "rollback", "prune", "note"), (4, 3, 2, 2, 1))[0]
            names = store.aliases()
            if what == "rollback" and "previous" not in names:
                continue
            target = names.get("candidate", names["current"])
            _say(writer, "begun", what, target, [])
            gone: list[str] = []
            if what == "add":
                number += 1
                draft = Draft(
                    hand="hand",
                    kind="calibrated",
                    terms={"kill": kill, "number": number},
                    parent=names["current"],
                )
                target = store.add(draft, f"<!-- {number} -->{_MODEL}", alias="candidate").id
            elif what == "promote":
                store.promote(target)
            elif what == "rollback":
                store.rollback()
            elif what == "note":
                store.note(target, f"noted before kill {kill}")
            else:
                gone = [choice.version for choice in prune(store, _POLICY) if choice.action != "keep"]
            _say(writer, "returned", what, target, gone, len(store.decisions().decisions))
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


def _say(writer: int, when: str, what: str, version: str, gone: list[str], decisions: int = 0) -> None:
    said = {"when": when, "what": what, "version": version, "gone": gone, "decisions": decisions, "named": True}
    os.write(writer, json.dumps(said).encode() + b"\n")


def main() -> None:
    """Prints what was cut off and what was wrong; ends with 1 if anything was."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--folder", type=Path, help="where to put the store; a folder of its own by default")
    parser.add_argument("--store", type=Path, help="the folder of the store itself, which then stays")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=chosen.folder) as folder:
        began = time.monotonic()
        outcome = run(chosen.store or Path(folder) / "hand", chosen.kills, chosen.seed)
        print(f"{outcome.kills} kills in {time.monotonic() - began:.0f} s, {outcome.returned} operations had returned")
        print("cut off: " + ", ".join(f"{what} {count}" for what, count in outcome.cut_off.most_common()))
        print(f"{len(outcome.wrong)} wrong", *outcome.wrong, sep="\n  ")
        raise SystemExit(1 if outcome.wrong else 0)


if __name__ == "__main__":
    main()
