"""What a laboratory would drive: one motion to fit, another kind of motion to judge by. Commands in rad (m of a slide).

To fit: sums of sines, steps with holds, small reversals, in some cases slow ramps, in another order for each servo.
Held out: two-speed ramps, sweeps and steps of other sizes. Everything moves at once, within the ranges of the joints.
"""

from __future__ import annotations

import numpy as np

from .dice import chance, dice, log_uniform
from .robots import Robot

_WIDEST_RAD = 1.0  # largest amplitude of a hinge


def commands(robot: Robot, seed: int, kind: str, seconds: float | None = None) -> np.ndarray:
    """(n, a) targets at the robot's rate. `kind` is "fit" or "holdout"; the length is drawn where it is not given."""
    random = dice(seed, f"motion {kind}")
    if seconds is None:
        low, high = (20.0, 30.0) if kind == "fit" else (16.0, 22.0)
        seconds = float(random.uniform(low, high))
    count = round(seconds * robot.rate_hz)
    reach = float(random.uniform(0.3, 0.42))
    slow = chance(random, 0.4)
    smooth = float(random.uniform(0.15, 0.6)) / robot.bandwidth_hz
    out = np.empty((count, len(robot.servos)))
    for index, servo in enumerate(robot.servos):
        hinge = not robot.tree.links[servo.joints[0]].slide
        amplitude = reach * (servo.high - servo.low)
        if hinge and len(servo.joints) == 1:
            amplitude = min(amplitude, _WIDEST_RAD)
        track = _track(random, kind, count, robot.rate_hz, robot.bandwidth_hz, slow)
        out[:, index] = (servo.low + servo.high) / 2 + amplitude * _smoothed(track, smooth * robot.rate_hz)
    return out


def _track(
    random: np.random.Generator, kind: str, count: int, rate_hz: float, bandwidth_hz: float, slow: bool
) -> np.ndarray:
    """(n,) in [-1, 1]: segments of all sorts in a random order, each of them at least once where the time allows."""
    pace = float(np.clip(3.0 / bandwidth_hz, 0.6, 1.6))
    sorts = ["sines", "steps", "reversals", "sines", "steps"] if kind == "fit" else ["ramps", "sweep", "steps", "ramps"]
    if slow:
        sorts.append("slow")
    parts: list[np.ndarray] = [np.zeros(max(1, round(0.5 * rate_hz)))]
    length, level = len(parts[0]), 0.0
    while length < count:
        for index in random.permutation(len(sorts)):
            part = _segment(random, sorts[index], level, pace, rate_hz, bandwidth_hz, kind)
            level = float(part[-1])
            parts.append(part)
            length += len(part)
    return np.concatenate(parts)[:count]


def _segment(
    random: np.random.Generator, sort: str, level: float, pace: float, rate_hz: float, bandwidth_hz: float, kind: str
) -> np.ndarray:
    """(k,) of one segment, from `level` on."""

    def ticks(seconds: float) -> int:
        return max(2, round(seconds * rate_hz))

    def towards(target: float, seconds: float) -> np.ndarray:
        return level + (target - level) * np.arange(1, ticks(seconds) + 1) / ticks(seconds)

    if sort == "sines":
        fastest = min(0.5 * bandwidth_hz, 2.0)
        time = np.arange(1, ticks(4.0 * pace) + 1) / rate_hz
        speeds = np.exp(random.uniform(np.log(0.15), np.log(fastest), 5))
        waves = np.sin(2 * np.pi * np.outer(time, speeds) + random.uniform(0, 2 * np.pi, 5)).sum(axis=1) / 3.2
        fade = np.clip(np.minimum(time, time[-1] - time) / 0.4, 0, 1)
        return np.clip(level * (1 - fade) + fade * waves, -1, 1)
    if sort == "sweep":
        time = np.arange(1, ticks(4.0 * pace) + 1) / rate_hz
        speed = np.linspace(0.2, min(0.6 * bandwidth_hz, 2.5), len(time))
        wave = np.sin(2 * np.pi * np.cumsum(speed) / rate_hz) * float(random.uniform(0.5, 0.9))
        fade = np.clip(np.minimum(time, time[-1] - time) / 0.4, 0, 1)
        return np.clip(level * (1 - fade) + fade * wave, -1, 1)
    if sort == "steps":
        size = (0.2, 1.2) if kind == "fit" else (0.1, 0.7)
        out, here = [], level
        for _ in range(3):
            move = float(random.uniform(*size)) * (1 if random.random() < 0.5 else -1)
            here = here - move if abs(here + move) > 1 else here + move
            here = float(np.clip(here, -1, 1))
            out.append(np.full(ticks(float(random.uniform(0.5, 1.1)) * pace), here))
        return np.concatenate(out)
    if sort == "reversals":
        size = log_uniform(random, 0.04, 0.2) * (-1 if level > 0 else 1)
        one = ticks(float(random.uniform(0.25, 0.6)) * pace)
        wave = level + size * (1 - np.abs(np.arange(1, 2 * one + 1) / one - 1))
        return np.tile(wave, 3)
    if sort == "ramps":
        target = float(random.uniform(-1, 1))
        there = towards(target, float(random.uniform(0.5, 1.0)) * pace)
        hold = np.full(ticks(0.3), target)
        level = target
        back = towards(float(random.uniform(-1, 1)), float(random.uniform(1.5, 2.5)) * pace)
        return np.concatenate([there, hold, back])
    target = float(random.uniform(0.5, 1.0)) * (-1 if level > 0 else 1)
    return towards(target, float(random.uniform(3.0, 5.0)))


def _smoothed(track: np.ndarray, ticks: float) -> np.ndarray:
    """A moving average over about so many ticks, twice: ramps with soft ends where there were steps."""
    half = int(ticks / 2)
    for _ in range(2):
        padded = np.pad(track, half, mode="edge")
        sums = np.cumsum(np.insert(padded, 0, 0.0))
        track = (sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1)
    return track
