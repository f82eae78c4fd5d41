"""Weeks of wear, drawn at random: when is it named, how often wrongly, and is an unworn hand left alone?

    python -m bench.wear_named --model right_hand.xml --folder /tmp/wear --hands 1 2 3 --page docs/wear-named.md

Each hand is a plant of `bench.changes_cases`: values up to 20 % off the file, a percent off between sessions. One
finger joint wears by a law that is drawn; each look is a recording of 16 s, compared with week 0 by `changes_since`.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from bench.changes_cases import BETWEEN_SESSIONS, FINGERS, SPREAD, Plant, plant_of, record
from twin_daemon.changes.answer import BY_TEMPERATURE, Change, Since
from twin_daemon.changes.search import changes_since
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.twin import TwinModel

WEEKS, SECONDS = 16, 16.0
SWING = 0.1
LAWS: Mapping[str, tuple[str | None, float, float]] = {
    "viscous friction grows": ("viscous_friction", 0.03, 0.08),
    "dry friction grows": ("coulomb_friction", 0.06, 0.15),
    "gain fades": ("actuator_gain", 0.015, 0.04),
    "play appears": ("backlash", 0.01, 0.025),
    "offset after a repair": ("sensor_offset", 0.01, 0.03),
    "temperature swings": (None, SWING, SWING),
    "nothing": (None, 0.0, 0.0),
    "tendon stretches": ("tendon_elasticity", 0.03, 0.08),
}
"""What wears: the effect that is right, the least and the greatest amount (a week; once, for play and an offset)."""
TENDON = 3.0
"""Times the servo's stiffness: a tendon's, before it stretches."""


@dataclass(frozen=True)
class Look:
    """One week: what it was worn by (a ratio or an amount), the effects that were named with their joint, amount and
    rivals, and the least that would have been seen."""

    week: int
    worn: float
    named: tuple[tuple[str, str, float, tuple[str, ...]], ...]
    verdict: str
    least: float | None
    took_s: float


@dataclass(frozen=True)
class Hand:
    """One hand over its weeks. `joint` is the one that wears, `effect` its right name, None where nothing does."""

    seed: int
    law: str
    joint: str
    effect: str | None
    looks: tuple[Look, ...]

    def right(self, name: tuple[str, str, float, tuple[str, ...]], week: int) -> bool:
        return name[0] == self.effect and self.joint == name[1] and self._is_worn(week)

    def _is_worn(self, week: int) -> bool:
        return next(look.worn for look in self.looks if look.week == week) not in (0.0, 1.0)

    def _tied(self, name: tuple[str, str, float, tuple[str, ...]], week: int) -> bool:
        """Whether another name stands first, and the right one is said to explain the same."""
        return name[0] != self.effect and f"{self.effect}:{self.joint}" in name[3] and self._is_worn(week)

    @property
    def tied(self) -> int:
        return sum(self._tied(name, look.week) for look in self.looks for name in look.named)

    @property
    def wrong(self) -> int:
        names = [(name, look.week) for look in self.looks for name in look.named]
        return sum(not self.right(*one) and not self._tied(*one) for one in names)

    @property
    def first_right(self) -> int | None:
        weeks = [look.week for look in self.looks if any(self.right(name, look.week) for name in look.named)]
        return min(weeks, default=None)

    @property
    def reached(self) -> int | None:
        """The first week that is worn by three times the detection limit of the first look."""
        limit = next((look.least for look in self.looks if look.least is not None), None)
        if limit is None or self.effect is None:
            return None
        worn = {look.week: abs(np.log(look.worn)) if limit > 1.0 else look.worn for look in self.looks if look.worn}
        bound = 3.0 * (float(np.log(limit)) if limit > 1.0 else limit)
        return min((week for week, amount in worn.items() if amount >= bound), default=None)


def watched(folder: Path, model: Path, seed: int, weeks: Sequence[int], slow: bool) -> Hand:
    """Makes a hand's recordings and compares each week with the first."""
    rng = np.random.default_rng([seed, 77])
    law = list(LAWS)[seed % len(LAWS)]
    effect, low, high = LAWS[law]
    rate, begins = float(rng.uniform(low, high)), int(rng.integers(3, 9))
    joint = f"rh_{rng.choice(FINGERS)}J3"
    body = rng.uniform(1.0 - SPREAD, 1.0 + SPREAD, (3, 64))
    warm = rng.uniform(0.3, 0.8), rng.uniform(0.0, 2.0 * np.pi)
    twin = TwinModel.load(load_hand(model=model))
    looks: list[Look] = []
    healthy = None
    for week in (0, *weeks):
        plant = plant_of(model, joint, body * rng.normal(1.0, BETWEEN_SESSIONS, (3, 64)))
        worn = _wear(plant, law, week, rate, begins, warm)
        bag = folder / f"{'slow_' if slow else ''}hand{seed}_week{week}"
        if not bag.exists():
            record(plant, bag, week, 1000 * seed + week, SECONDS, rng, slow=slow)
        read = align(twin, load_recording(bag))
        if healthy is None:
            healthy = read
            continue
        began = time.process_time()
        found = changes_since(twin, [healthy], [read], joints=[joint])
        named = tuple((c.effect, c.joints[0], _amount(c), c.rivals) for c in found.changes)
        looks.append(Look(week, worn, named, found.verdict, _least(found, effect), time.process_time() - began))
        print(f"{seed} {law:22} {joint} week {week:2} worn {worn:.3g} {found.verdict:13} {named}", flush=True)
    return Hand(seed, law, joint, effect, tuple(looks))


def _wear(plant: Plant, law: str, week: int, rate: float, begins: int, warm: tuple[float, float]) -> float:
    """Wears a plant; the ratio, or the amount, that it is worn by."""
    m, dof, a = plant.model, int(plant.model.jnt_dofadr[plant.joint]), plant.actuator
    if law == "temperature swings":
        sway = 1.0 + rate * float(np.sin(warm[0] * week + warm[1]) - np.sin(warm[1]))
        m.dof_damping *= sway
        m.dof_frictionloss *= sway
        return sway
    if law == "viscous friction grows":
        m.dof_damping[dof] *= 1.0 + rate * week
        return 1.0 + rate * week
    if law == "dry friction grows":
        m.dof_frictionloss[dof] *= 1.0 + rate * week
        return 1.0 + rate * week
    if law == "gain fades":
        ratio = 1.0 - rate * week
        m.actuator_gainprm[a, 0] *= ratio
        m.actuator_biasprm[a, 1] *= ratio
        return ratio
    if law == "tendon stretches":
        ratio = 1.0 / (1.0 + rate * week)
        plant.tendon = TENDON * ratio * float(m.actuator_gainprm[a, 0])
        return ratio
    there = rate if week >= begins else 0.0
    if law == "play appears":
        plant.gap_rad = there
        return there
    if law == "offset after a repair":
        plant.offset_rad = there
        return there
    return 0.0


def _amount(change: Change) -> float:
    """The ratio where there is one, else the value now."""
    return change.ratio.value if np.isfinite(change.ratio.value) else change.now.value


def _least(found: Since, effect: str | None) -> float | None:
    """The least ratio or amount of the right change that this look would have shown, where it has shown none."""
    said = next((one for one in found.unchanged if one.effect == effect), None)
    return None if said is None else said.least_ratio or said.least


def page(hands: Sequence[Hand], slow: bool) -> str:
    """The table, and the rates below it."""
    rows, within, late = [], 0, 0
    for hand in hands:
        due, first = hand.reached, hand.first_right
        until = None if due is None else next((w for w in sorted(look.week for look in hand.looks) if w > due), due)
        if until is not None:
            late += 1
            within += first is not None and first <= until
        told = sorted({f"{n[0]} at {n[1]}" for look in hand.looks for n in look.named})
        cells = (hand.seed, hand.law, hand.joint, due or "-", first or "-", hand.wrong, ", ".join(told) or "-")
        rows.append("| " + " | ".join(map(str, cells)) + " |")
    looks = sum(len(hand.looks) for hand in hands)
    swings = [hand for hand in hands if hand.law == "temperature swings"]
    wrong, tied = (sum(getattr(hand, what) for hand in hands if hand not in swings) for what in ("wrong", "tied"))
    under_swings = [name for hand in swings for look in hand.looks for name in look.named]
    weather = sum(BY_TEMPERATURE in name[3] for name in under_swings)
    unworn = [hand for hand in hands if hand.law == "nothing"]
    alarms = sum(len(look.named) for hand in unworn for look in hand.looks)
    silent = sum(look.verdict == "not_excited" for hand in hands for look in hand.looks)
    seconds = float(np.median([look.took_s for hand in hands for look in hand.looks]))
    motion = "one slow closing and opening" if slow else "ramps, steps and sines"
    return _PAGE.format(
        motion=motion, rows="\n".join(rows),
        hands=len(hands), looks=looks, within=within, late=late, wrong=wrong, tied=tied,
        unworn=len(unworn), alarms=alarms, swayed=len(under_swings) - weather, weather=weather,
        silent=silent, seconds=seconds,
    )  # fmt: skip


_PAGE = """# Weeks of wear, named

Made by `python -m bench.wear_named --model right_hand.xml --folder FOLDER --hands N... --page docs/wear-named.md`. Each
hand is a simulated Shadow Hand with values up to 20 % off the model and a percent off between sessions. One finger
joint wears by a law drawn at random. Each look is a recording of 16 s of {motion},
compared with week 0 (`twin diagnose --baseline`); only the joint that wears is looked at. *Reached* is the first look
at which the wear is three times what the first look would have shown. A name before anything has worn counts as
wrong, and so does a second name beside the right one.

| hand | law | joint | reached | first right name | wrong names | named |
|---|---|---|---|---|---|---|
{rows}

{hands} hands, {looks} looks: named rightly by the look after *reached* {within} of {late} hands; wrong names {wrong},
and {tied} that stood first and were said to be as likely as the right one; false alarms on unworn hands {alarms}
({unworn} hands); names under swings of temperature that are called wear {swayed}, and
{weather} that are said to be as likely the temperature's. In {silent} looks the joint had too little motion clear of
contacts, and was not judged. A look took {seconds:.0f} s of one core (median).

Friction that has changed under a swing of temperature is no wear, and one comparison of one joint cannot know.
The history can (`twin versions history --covariate FILE.csv`, [versions.md](versions.md)).
"""


def main() -> None:
    """Looks at the hands that are asked for, keeps what each has shown, and writes the page of all in the folder."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--model", type=Path, required=True, help="the third-party Shadow Hand's MJCF")
    parser.add_argument("--folder", type=Path, required=True, help="recordings and answers")
    parser.add_argument("--hands", type=int, nargs="+", default=[0])
    parser.add_argument("--weeks", type=int, nargs="+", default=list(range(1, WEEKS + 1)))
    parser.add_argument(
        "--slow", action="store_true", help="each look is one slow closing and opening, not a rich motion"
    )
    parser.add_argument("--page", type=Path)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    kind = "slow_hand" if given.slow else "hand"  # a look is never compared with one of another motion
    for seed in given.hands:
        answer = given.folder / f"{kind}{seed}.json"
        if not answer.exists():
            answer.write_text(json.dumps(asdict(watched(given.folder, given.model, seed, given.weeks, given.slow))))
    hands = [_read(path) for path in sorted(given.folder.glob(f"{kind}*.json"))]
    text = page(hands, given.slow)
    print(text)
    if given.page:
        given.page.write_text(text, encoding="utf-8")


def _read(path: Path) -> Hand:
    told = json.loads(path.read_text())
    looks = tuple(
        Look(**look | {"named": tuple((*name[:3], tuple(name[3])) for name in look["named"])})
        for look in told.pop("looks")
    )
    return Hand(**told, looks=looks)


if __name__ == "__main__":
    main()
