"""The cases of the suite: which robot, which motions, what is hidden and how strong, all from one number, the seed.

Even seeds are for development, odd ones for the test. Both halves have the same kinds of cases in the same order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .dice import chance, dice, log_uniform, pick
from .laws import EVERYWHERE, FOREIGN, LIBRARY, Law, Site
from .laws.bodies import Tilt
from .laws.springs import Coupling
from .motions import commands
from .plants import Plant, Touching, Unstable, measured, nominal
from .robots import Robot, draw_robot, with_limits
from .strength import calibrated, response, rms

WEAKEST, STRONGEST = 1.5, 30.0
_CERTAIN = 3.0  # of laws of no library and of two at once: where an answer may be asked for
_HALVES = ("development", "test")
_PATTERN = 5 * "SNSESFSP"
_KINDS = {"N": "nothing", "S": "single", "E": "robot", "F": "foreign", "P": "pair"}
_ATTEMPTS = 40


@dataclass(frozen=True)
class Plan:
    """What a seed is to become. `laws` holds the forms that the hidden law may have, none for a pair."""

    seed: int
    kind: str  # nothing, single, robot, foreign, pair
    laws: tuple[type[Law], ...]

    @property
    def name(self) -> str:
        return f"case_{self.seed:04d}"

    @property
    def half(self) -> str:
        return _HALVES[self.seed % 2]


def plans(count: int, half: str | None = None, first: int = 0) -> list[Plan]:
    """The first `count` plans from the seed `first` on, of one half or of both."""
    step, start = 1, first
    if half is not None:
        step, start = 2, first + (first + _HALVES.index(half)) % 2
    return [plan(seed) for seed in range(start, start + step * count, step)]


def plan(seed: int) -> Plan:
    """Kind and law of a seed. Forty seeds of a half hold each kind in its share; laws follow one another."""
    number = seed // 2
    rank = number % len(_PATTERN)
    letter = _PATTERN[rank]
    before = number // len(_PATTERN) * _PATTERN.count(letter) + _PATTERN[:rank].count(letter)
    groups: dict[str, Sequence[tuple[type[Law], ...]]] = {
        "S": LIBRARY, "E": [(law,) for law in EVERYWHERE], "F": [(law,) for law in FOREIGN],
    }  # fmt: skip
    laws: tuple[type[Law], ...] = ()
    if letter in groups:
        # not in the library's own order, so that a small sample has laws of all sorts
        laws = groups[letter][(7 * before + 3) % len(groups[letter])]
    return Plan(seed, _KINDS[letter], laws)


@dataclass(frozen=True)
class Hidden:
    """A law at work: its rms response over the whole floor, and over that of the sensors alone."""

    law: Law
    strength: float
    over_sensors: float


@dataclass(frozen=True)
class Case:
    """A robot with what is hidden in it; recordings are simulated when they are asked for."""

    plan: Plan
    robot: Robot
    plant: Plant
    error: str
    hidden: tuple[Hidden, ...]
    draw: int  # of the robot and its motion

    def targets(self, kind: str) -> np.ndarray:
        """(n, a) commands of the motion "fit" or "holdout"."""
        return commands(self.robot, self.draw, kind)

    def recording(self, kind: str) -> Recording:
        targets = self.targets(kind)
        angles = self.plant.run(targets, [hidden.law for hidden in self.hidden])
        stamps, readings = measured(self.robot, angles, self.plan.seed, kind)
        return Recording(np.arange(len(targets)) / self.robot.rate_hz, targets, stamps, readings)


@dataclass(frozen=True)
class Recording:
    """Commands (n, a) at `sent_s` (n,), readings (n, j) at `stamps_s` (n,)."""

    sent_s: np.ndarray
    targets: np.ndarray
    stamps_s: np.ndarray
    readings: np.ndarray


@dataclass(frozen=True)
class Draft:
    """A robot that moves as it should, before anything is hidden in it."""

    robot: Robot
    plant: Plant
    targets: np.ndarray  # (n, a) of the fit
    angles: np.ndarray  # (n, j) of the nominal model
    peaks: np.ndarray  # (a,) N m

    @cached_property
    def sound(self) -> np.ndarray:
        """(n, j) of the plant without laws."""
        return self.plant.run(self.targets)

    @cached_property
    def floor(self) -> np.ndarray:
        """(j,) rad: sensors, and what the nominal model itself lacks."""
        return np.hypot(self.robot.floor(), rms(self.sound - self.angles))

    def site(self, law: type[Law], random: np.random.Generator) -> Site | None:
        """A place for the law, at random; None where the robot has none."""
        servos = self.robot.servos
        pairs = [index for index, servo in enumerate(servos) if len(servo.joints) > 1]
        if law.at == "pair":
            places = [(servos[index].joints[-1], index) for index in pairs]
        elif law.at in ("servo", "robot"):
            places = [(servo.joints[-1], index) for index, servo in enumerate(servos)]
        else:
            joints = range(len(self.robot.joints))
            places = [(joint, self.robot.servo_of(joint)) for joint in joints]
            if law.at == "lone":
                places = [place for place in places if place[1] not in pairs]
        if not places:
            return None
        joint, servo = pick(random, places)
        # a tendon's own speeds count for what acts on its command
        return Site(self.robot, joint, servo, self.angles[:, joint], self.targets[:, servo], float(self.peaks[servo]),
                    self.angles)  # fmt: skip


def build(plan: Plan, error: str | None = None) -> Case:
    """The case of a plan. `error` names what the nominal model is off by (see MODEL_ERRORS); drawn if not given."""
    for attempt in range(_ATTEMPTS):
        draw = plan.seed * 64 + attempt
        random = dice(draw, "hidden")
        how = error or str(random.choice(["exact", "bodies", "values10"], p=[0.2, 0.65, 0.15]))
        try:
            draft = _draft(plan, draw, how)
            hidden = _hide(plan, draft, random)
        except Unstable:
            continue
        if hidden is not None:
            return Case(plan, draft.robot, draft.plant, how, hidden, draw)
    raise Unstable(f"{plan.name}: no robot of {_ATTEMPTS} can have what is planned")


def _draft(plan: Plan, draw: int, error: str) -> Draft:
    random = dice(draw, "family")
    family = str(random.choice(["finger", "hand", "arm", "gantry"], p=[0.3, 0.25, 0.3, 0.15]))
    pair = None
    if Coupling in plan.laws:
        family, pair = pick(random, ("finger", "hand")), True
    elif Tilt in plan.laws:
        family = pick(random, ("hand", "arm"))
    robot = draw_robot(draw, family, pair)
    targets = {kind: commands(robot, draw, kind) for kind in ("fit", "holdout")}
    try:
        peaks = np.max([nominal(robot, track)[1] for track in targets.values()], axis=0)
    except Touching:
        robot = replace(robot, contacts=False)
        peaks = np.max([nominal(robot, track)[1] for track in targets.values()], axis=0)
    robot = with_limits(robot, peaks, draw)
    angles, peaks = nominal(robot, targets["fit"])
    return Draft(robot, Plant(robot, draw, error), targets["fit"], angles, peaks)


def _hide(plan: Plan, draft: Draft, random: np.random.Generator) -> tuple[Hidden, ...] | None:
    """What is hidden, each at its strength; None where this robot cannot have it."""
    if plan.kind == "nothing":
        return () if np.isfinite(draft.sound).all() else None
    weakest = WEAKEST if plan.kind in ("single", "robot") else _CERTAIN
    if plan.kind != "pair":
        one = _placed(pick(random, plan.laws), draft, random, weakest)
        return None if one is None else (one,)
    first = _placed(_any_law(random), draft, random, weakest)
    if first is None:
        return None
    for _ in range(6):
        second = _placed(_any_law(random), draft, random, weakest)
        if second is not None and _together(first.law, second.law):
            draft.plant.run(draft.targets, [first.law, second.law])  # raises where the two cannot live together
            return (first, second)
    return None


def _any_law(random: np.random.Generator) -> type[Law]:
    """A law of the library or, in a tenth of the draws, one of the whole robot."""
    if chance(random, 0.1):
        return pick(random, EVERYWHERE)
    return pick(random, pick(random, LIBRARY))


def _together(one: Law, other: Law) -> bool:
    """Whether two laws are two causes: not the same one, not both in the place of one servo."""
    same = one.site.servo == other.site.servo
    if one.key == other.key or {one.at, other.at} == {"robot"}:
        return False
    return not (same and one.claims and other.claims)


def _placed(law: type[Law], draft: Draft, random: np.random.Generator, weakest: float) -> Hidden | None:
    """The law at a random place with a strength between `weakest` and STRONGEST; None where no place can have it."""
    wanted = log_uniform(random, weakest, STRONGEST)
    for _ in range(3):
        site = draft.site(law, random)
        if site is None or site.span <= 0:
            return None
        one = law(site, random)
        if one.key == "x_crosstalk" and len(draft.robot.joints) < 2:
            return None
        sensors = draft.robot.floor()
        reached = calibrated(one, draft.plant, draft.targets, draft.sound, draft.floor, wanted)
        if reached >= weakest:
            return Hidden(one, reached, response(one, draft.plant.run(draft.targets, [one]), draft.sound, sensors))
    return None
