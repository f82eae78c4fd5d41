"""Drives a plant through a motion and keeps what the bus would have carried: the measurements and the commands.

What is hidden in the plant is not written with them; `Plant.hidden` is the answer, to be kept elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.hand import match
from twin_daemon.signals.trajectory import Trajectory

from .plant import Plant

Motion = Trajectory | Callable[[float], Mapping[str, float]]
"""A trajectory, or {command: rad} as a function of time (s)."""

EPOCH_NS = 1_700_000_000_000_000_000
"""Stamp of time 0 where none is given: the same run gives the same bytes."""


@dataclass(frozen=True)
class Run:
    """What was seen and told. Times in s since the motion's start; commands begin one tick before it."""

    time_s: np.ndarray  # (n,) as stamped, jitter included
    joints: tuple[str, ...]
    position: np.ndarray  # (n, j) rad
    velocity: np.ndarray  # (n, j) rad/s
    effort: np.ndarray  # (n, j) N m
    true_position: np.ndarray  # (n, j) rad, which no recording carries
    command_time_s: np.ndarray  # (m,)
    commands: tuple[str, ...]
    command: np.ndarray  # (m, c) rad, held until the next

    def column(self, joint: str) -> np.ndarray:
        """(n,) measured rad of one joint."""
        return self.position[:, self.joints.index(joint)]


def simulate(
    plant: Plant,
    motion: Motion,
    *,
    duration_s: float | None = None,
    rate_hz: float | None = None,
    command_rate_hz: float | None = None,
    jitter_s: float = 0.0,
    settle_s: float = 1.0,
    start: Mapping[str, float] | None = None,
    seed: int = 0,
) -> Run:
    """Runs the motion from rest.

    The plant is reset to `start` ({joint: rad}; by default the pose that the first targets ask for, pairs shared
    evenly), holds the first targets for `settle_s`, and then gets targets at `command_rate_hz` (the hand's own rate by
    default) while it is measured at `rate_hz`. Both clocks have their own phase, as on a bus; stamps of measurements
    are off by up to `jitter_s`. `duration_s` is needed for a function only.
    """
    rate = rate_hz or plant.hand.description.rate_hz
    command_rate = command_rate_hz or rate
    if duration_s is None:
        if not isinstance(motion, Trajectory):
            raise BadInput("a motion given as a function has no end of its own", todo="Give duration_s")
        duration_s = motion.duration_s
    if not 0.0 <= jitter_s < 0.5 / rate:
        raise BadInput(
            f"stamps with a jitter of {jitter_s:g} s would overtake each other", allowed=f"below {0.5 / rate:g} s"
        )
    targets = _targets(plant, motion)
    random = np.random.default_rng([seed, 3])
    times = np.arange(int(np.floor(duration_s * rate + 1e-9)) + 1) / rate
    phase = round(float(random.uniform(0.0, 1.0)) / command_rate, 3)  # whole steps of any plant: no rounding of its own
    ticks = phase + np.arange(-1, int(np.floor((duration_s - phase) * command_rate)) + 1) / command_rate

    plant.reset(_pose(plant, targets(0.0)) if start is None else start)
    plant.set_targets(targets(0.0))
    plant.advance(settle_s)
    zero_s = plant.time_s
    sent = np.empty((len(ticks), len(plant.commands)))
    seen = np.empty((4, len(times), len(plant.joints)))
    sample = 0
    for index, tick in enumerate(ticks):
        until = ticks[index + 1] if index + 1 < len(ticks) else np.inf
        if tick > 0.0:
            plant.advance(zero_s + tick - plant.clock_s)
        plant.set_targets(targets(max(float(tick), 0.0)))
        sent[index] = plant.targets
        while sample < len(times) and times[sample] < until:
            plant.advance(zero_s + times[sample] - plant.clock_s)
            _, seen[0, sample], seen[1, sample], seen[2, sample] = plant.measure()
            seen[3, sample] = plant.position
            sample += 1
    stamped = times + jitter_s * random.uniform(-1.0, 1.0, len(times))
    return Run(stamped, plant.joints, seen[0], seen[1], seen[2], seen[3], ticks, plant.commands, sent)


def record(plant: Plant, motion: Motion, path: Path | str, *, start_ns: int = EPOCH_NS, **how: object) -> Run:
    """Like `simulate` (which explains `how`), written to `path` as a ROS 2 bag in MCAP. Returns what was written."""
    from twin_daemon.recordings.writer import McapWriter  # bags are heavy to import, and simulate needs none

    run = simulate(plant, motion, **how)  # type: ignore[arg-type]
    measured = [(start_ns + round(t * 1e9), 1, i) for i, t in enumerate(run.time_s)]
    told = [(start_ns + round(t * 1e9), 0, i) for i, t in enumerate(run.command_time_s)]
    with McapWriter(Path(path)) as bag:
        for stamp_ns, is_measured, i in sorted(measured + told):
            if is_measured:
                bag.joint_states(stamp_ns, run.joints, run.position[i], run.velocity[i], run.effort[i])
            else:
                bag.joint_commands(stamp_ns, run.commands, run.command[i])
    return run


def _targets(plant: Plant, motion: Motion) -> Callable[[float], Mapping[str, float]]:
    """The motion by command; joints of a pair become their sum."""
    if not isinstance(motion, Trajectory):
        return motion
    by_command = motion.by_command(plant.hand)
    names = by_command.joints
    return lambda time_s: dict(zip(names, by_command.sample(np.array([time_s]))[0].tolist(), strict=True))


def _pose(plant: Plant, targets: Mapping[str, float]) -> dict[str, float]:
    """{joint: rad} where these targets are met."""
    commands = plant.hand.description.commands
    pose: dict[str, float] = {}
    for name, target in targets.items():
        command = match(name, commands) or name
        if command in commands:
            joints = commands[command].joints
            pose |= {joint: plant.rig.joint_angle(command, joint, target / len(joints)) for joint in joints}
    return pose
