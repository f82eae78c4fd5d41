"""Motions for the plant: a slow closing, which shows little, and a rich one, which tells effects apart."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.hand import Hand, canonical, match
from twin_daemon.signals.trajectory import Trajectory

_STEP_S = 0.008
"""A step is a ramp of this length: one tick of a 125 Hz command stream."""
_MARGIN = 0.08
_WIDEST_RAD = 2.0
_FINGER = re.compile(r"[FMRL]FJ[03]$")


def slow_closing(hand: Hand, *, seconds: float = 7.0) -> Trajectory:
    """Rest, close in three sevenths of `seconds`, open again, rest: the fingers, or every joint of another robot."""
    fingers = [name for name in hand.commands if _FINGER.match(canonical(name))]
    names = tuple(fingers or hand.commands)
    start = np.array([_usual_range(hand, name)[0] for name in names])
    closed = np.array([low + 0.9 * (high - low) for low, high in (_usual_range(hand, name) for name in names)])
    open_pose = np.maximum(start, np.minimum(0.0, closed))
    times = seconds / 7.0 * np.array([0.0, 0.5, 3.5, 6.5, 7.0])
    return Trajectory("slow_closing", names, times, np.stack([open_pose, open_pose, closed, open_pose, open_pose]))


def rich(hand: Hand, joints: Sequence[str] = (), seconds: float = 30.0, seed: int = 0) -> Trajectory:
    """Steps, slow and fast ramps, small reversals and holds on the given commands (all if none), each its own dice."""
    names = [_command(hand, joint) for joint in joints] or list(hand.commands)
    names = list(dict.fromkeys(names))
    tracks = [
        _track(*_usual_range(hand, name), seconds, np.random.default_rng([seed, i])) for i, name in enumerate(names)
    ]
    times = np.unique(np.concatenate([track[0] for track in tracks]))
    positions = np.stack([np.interp(times, when, angle) for when, angle in tracks], axis=1)
    return Trajectory(f"rich_{seed}", tuple(names), times, positions)


def _track(low: float, high: float, seconds: float, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Times (w,) s and angles (w,) rad of one command, from its rest angle, over exactly `seconds`."""
    span = high - low
    times, angles = [0.0], [min(max(0.0, low), high)]

    def go(angle: float, duration: float) -> None:
        times.append(times[-1] + duration)
        angles.append(min(max(angle, low), high))

    def toward(share: float) -> float:
        """An angle `share` of the span away, into the side with room, at random where both have it."""
        here, move = angles[-1], share * span
        sides = [side for side in (-1.0, 1.0) if low <= here + side * move <= high]
        return here + float(random.choice(sides)) * move if sides else (low + high) / 2

    go(angles[0], 0.5)
    while times[-1] < seconds:
        go(high, 0.5)  # every round sees the upper end, where stops and springs are
        go(angles[-1], 0.2)
        go(low + float(random.uniform(0.4, 0.7)) * span, 0.5)
        for segment in random.permutation(6):
            share = float(random.uniform(0.8, 1.2))
            if segment == 0:
                go(toward(0.4 * share), _STEP_S)
                go(angles[-1], 0.6)
            elif segment == 1:
                go(toward(0.1 * share), _STEP_S)
                go(angles[-1], 0.4)
            elif segment == 2:
                go(toward(0.3 * share), 2.0)
            elif segment == 3:
                go(toward(0.5 * share), 0.4)
                go(angles[-1], 0.2)
            elif segment == 4:
                here, size = angles[-1], toward(0.06 * share) - angles[-1]
                for side in (1.0, 0.0, 1.0, 0.0):
                    go(here + side * size, 0.15)
            else:
                go(angles[-1], 0.6)
    when, angle = np.array(times), np.array(angles)
    inside = when < seconds - 1e-9
    end = float(np.interp(seconds, when, angle))
    return np.append(when[inside], seconds), np.append(angle[inside], end)


def _usual_range(hand: Hand, command: str) -> tuple[float, float]:
    """The range of a command with a margin; at most 2 rad about its middle for joints that turn far or freely."""
    low, high = hand.command_range_rad[command]
    if len(hand.description.commands[command].joints) == 1 or not math.isfinite(high - low):
        low, high = max(low, -math.pi), min(high, math.pi)
        middle, half = (low + high) / 2, min((high - low) / 2, _WIDEST_RAD / 2)
        low, high = middle - half, middle + half
    margin = _MARGIN * (high - low)
    return low + margin, high - margin


def _command(hand: Hand, joint: str) -> str:
    """The command called `joint`, or the one that moves it."""
    found = match(joint, hand.commands)
    if found is not None:
        return found
    named = match(joint, hand.joints)
    for command, info in hand.description.commands.items():
        if named in info.joints:
            return command
    raise BadInput(f"{hand.name} has no command that moves '{joint}'", todo=nearest(joint, hand.commands))
