"""What the gate is about to do: where to be at each turn. The shaper decides how to get there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.limits import Limits
from twin_daemon.gate.shaper import Shaper
from twin_daemon.hand import Hand, match
from twin_daemon.signals.trajectory import RANGE_TOLERANCE_RAD, Trajectory

Angle = TypeVar("Angle", float, np.ndarray)
_ARRIVED_RAD = 1e-4
_FASTEST_SHARE = 1.875  # of a minimum-jerk motion: its greatest velocity over its mean one


@dataclass(eq=False)
class Motion:
    """`table` (n, c) rad: where to be, one row a turn of `dt_s`, NaN for commands that it does not move.

    The first row is where the setpoints are when it begins; at the end they stay at the last row. A single row is
    a target to go to.
    """

    kind: str
    name: str
    table: np.ndarray
    dt_s: float
    elapsed_s: float = 0.0

    @property
    def moved(self) -> np.ndarray:
        """(c,) bool: which commands it moves."""
        return np.isfinite(self.table[0])

    @property
    def duration_s(self) -> float:
        return (len(self.table) - 1) * self.dt_s

    def advance(self, dt_s: float) -> np.ndarray:
        """(c,) where to be after a further turn of `dt_s`."""
        self.elapsed_s += dt_s
        place = min(self.elapsed_s / self.dt_s, len(self.table) - 1.0)
        row = min(int(place), len(self.table) - 2)
        if row < 0:
            return self.table[0]
        return self.table[row] + (place - row) * (self.table[row + 1] - self.table[row])

    def over(self, setpoint: np.ndarray, still: bool) -> bool:
        """Whether the setpoints (c,) have come to its end."""
        if not still or self.elapsed_s < self.duration_s:
            return False
        return bool((np.abs(setpoint - self.table[-1])[self.moved] <= _ARRIVED_RAD).all())

    def fastest(self) -> np.ndarray:
        """(c,) rad/s: the greatest velocity that the plan itself asks for; 0 for what it does not move."""
        if len(self.table) < 2:
            return np.zeros(self.table.shape[1])
        return np.fmax(np.abs(np.diff(self.table, axis=0)).max(axis=0) / self.dt_s, 0.0)


def commands_of(hand: Hand, targets: Mapping[str, Angle]) -> dict[str, Angle]:
    """Targets by command: J1 and J2 together are their J0. A target is an angle, or an array of angles over time.

    Raises BadInput for what drives nothing or only half.
    """
    found: dict[str, str] = {}
    for name in targets:
        known = match(name, dict.fromkeys((*hand.commands, *hand.joints)))
        if known is None:
            raise BadInput(f"no joint or command '{name}'", todo=nearest(name, hand.commands))
        if known in found:
            raise BadInput(f"'{known}' is named twice, as '{found[known]}' and as '{name}'", todo="Name it once")
        found[known] = name
    out: dict[str, Angle] = {}
    left = dict(found)
    for command, info in hand.description.commands.items():
        parts = [joint for joint in info.joints if joint in found]
        if command in found and (len(info.joints) == 1 or not parts):
            out[command] = targets[found[command]]
            left.pop(command)
        elif command in found:
            raise BadInput(f"'{command}' and '{parts[0]}' are both named, but the one drives the other")
        elif parts and len(parts) < len(info.joints):
            missing = ", ".join(sorted(set(info.joints) - set(parts)))
            raise BadInput(
                f"'{parts[0]}' without {missing}: one motor moves them together", todo=f"Name '{command}', their sum"
            )
        elif parts:
            together, *others = (targets[found[joint]] for joint in parts)
            for other in others:
                together = together + other
            out[command] = together
        for joint in parts:
            left.pop(joint, None)
    if left:
        raise BadInput(f"no motor moves '{next(iter(left))}'", todo=nearest("", hand.commands))
    return out


def row_of(limits: Limits, targets: Mapping[str, float]) -> np.ndarray:
    """(c,) targets by command; NaN where there is none."""
    return within_rounding(limits, np.array([targets.get(name, np.nan) for name in limits.names]))


def within_rounding(limits: Limits, targets: np.ndarray) -> np.ndarray:
    """Targets (..., c), clipped where no more than a rounded bound lies outside."""
    clipped = limits.clip(targets)
    return np.where(np.abs(clipped - targets) <= RANGE_TOLERANCE_RAD, clipped, targets)


def _outside(limits: Limits, targets: np.ndarray) -> bool:
    return bool(((targets < limits.lower) | (targets > limits.upper)).any())


def to_target(limits: Limits, targets: Mapping[str, float], dt_s: float) -> Motion:
    """Straight to a streamed target, as fast as the limits let it."""
    return Motion("target", "target", row_of(limits, targets)[None], dt_s)


def smooth_move(
    limits: Limits, begin: np.ndarray, targets: Mapping[str, float], seconds: float | None, share: float, dt_s: float
) -> Motion:
    """From `begin` (c,) to the targets with the least jerk (Flash and Hogan 1985); without a time, at a share of the
    velocity limits."""
    end = row_of(limits, targets)
    start = np.where(np.isfinite(end), begin, np.nan)
    if _outside(limits, end):  # it will be refused, and how long it would take may be any number
        return Motion("move", "move", np.stack([start, end]), dt_s)
    needed_s = _FASTEST_SHARE * np.abs(end - start) / (share * limits.velocity)
    length_s = float(np.nan_to_num(needed_s).max(initial=0.0)) if seconds is None else seconds
    count = max(2, int(np.ceil(length_s / dt_s)) + 1)
    s = np.linspace(0.0, 1.0, count)[:, None]
    blend = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return Motion("move", "move", start + blend * (end - start), dt_s)


def along(
    limits: Limits, hand: Hand, begin: np.ndarray, plan: Trajectory, lead_s: float | None, share: float, dt_s: float
) -> Motion:
    """From `begin` (c,) smoothly to the start of a trajectory, in `lead_s` or at a share of the velocity limits, then
    along it. Raises BadInput where it does not fit."""
    if len(set(plan.joints)) < len(plan.joints):
        raise BadInput("a joint is named twice", todo="Name each joint once")
    times = np.append(np.arange(0.0, plan.duration_s, dt_s), plan.duration_s)
    sampled = plan.sample(times)
    table = np.full((len(times), len(limits.names)), np.nan)
    for command, column in commands_of(hand, dict(zip(plan.joints, sampled.T, strict=True))).items():
        table[:, limits.names.index(command)] = column
    table = within_rounding(limits, table)
    if _outside(limits, table):
        return Motion("trajectory", plan.name, table, dt_s)
    start = dict(zip(limits.names, table[0].tolist(), strict=True))
    lead_in = smooth_move(limits, begin, start, lead_s, share, dt_s)
    return Motion("trajectory", plan.name, np.concatenate([lead_in.table, table[1:]]), dt_s)


def shaped(limits: Limits, begin: np.ndarray, motion: Motion, most_s: float = 3600.0) -> Iterator[np.ndarray]:
    """The setpoints (c,) that a motion from rest at `begin` (c,) becomes, turn by turn."""
    shaper = Shaper(limits)
    shaper.begin(np.where(motion.moved, begin, np.nan))
    for _ in range(int(most_s / motion.dt_s)):
        shaper.take(*shaper.toward(motion.advance(motion.dt_s), motion.dt_s))
        yield shaper.position
        if motion.over(shaper.position, shaper.still):
            return
