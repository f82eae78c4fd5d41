"""Recordings of a simulated hand whose parameters are known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from twin_daemon.recordings.quality import Quality, measure_timing
from twin_daemon.recordings.recording import Commands, Recording
from twin_daemon.recordings.writer import McapWriter
from twin_daemon.signals.commands import CommandSignal
from twin_daemon.simulation.alignment import resample
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

Motion = Mapping[str, tuple[list[float], list[float]]]
"""Waypoints by command: times (s) and targets (rad), linear between them."""

START_NS = 1_700_000_000_000_000_000
RATE_HZ = 125

# Two speeds, steps, holds and reversals of one finger; the coupled pair moves while its neighbour holds and then
# the other way round.
_PAIR_S = [0, 0.5, 1.0, 1.5, 2.0, 2.01, 2.6, 3.4, 4.0, 4.6, 5.5]
_PAIR_RAD = [0.2, 0.2, 1.8, 1.8, 1.2, 1.5, 1.5, 0.5, 0.7, 0.3, 0.3]
_BASE_S = [0, 1.0, 1.3, 1.9, 2.7, 3.0, 3.01, 3.6, 4.8, 5.2, 5.5]
_BASE_RAD = [0.1, 0.1, 1.1, 0.9, 0.9, 0.4, 0.8, 0.8, 0.2, 0.5, 0.5]
FINGER: Motion = {"rh_FFJ0": (_PAIR_S, _PAIR_RAD), "rh_FFJ3": (_BASE_S, _BASE_RAD)}


def recorded(
    plant: TwinModel,
    motion: Motion,
    rng: np.random.Generator,
    *,
    seconds: float = 5.5,
    noise_rad: float = 3e-4,
    commands: bool = True,
    late_s: float = 0.0,
    name: str = "made",
) -> Recording:
    """The plant under a motion, read at 125 Hz with noise. The motion begins `late_s` after the recording."""
    time_s = np.arange(round(seconds * RATE_HZ) + 1) / RATE_HZ
    stamp_ns = START_NS + np.round(time_s * 1e9).astype(np.int64)
    targets = np.column_stack([np.interp(time_s - late_s, *points) for points in motion.values()])
    stream = Commands(stamp_ns, tuple(motion), targets, "hold")
    step_s = float(plant.model.opt.timestep)
    grid = np.arange(int(np.ceil(seconds / step_s)) + 1) * step_s
    start = plant.initial_qpos(np.full(len(plant.joints), np.nan))
    signal = CommandSignal.from_stream(stream, START_NS)
    rest = plant.controls(signal.names, signal.sample(np.zeros(1)), np.zeros(len(plant.actuators)))
    # the hand has come to rest at the first target before the recording begins
    settled = roll_out([plant.model], np.repeat(rest[None], round(2.0 / step_s), axis=1), start[None])[0, -1]
    controls = plant.controls(signal.names, signal.sample(grid), rest[0])
    positions = roll_out([plant.model], controls[None], settled[None])
    read = plant.measurement.apply(plant.joints, resample(positions[:, :, plant.qpos_adr], step_s, time_s)[0])
    measured = read + noise_rad * rng.standard_normal(read.shape)
    quality = Quality(messages=len(stamp_ns), **measure_timing(stamp_ns))
    return Recording(
        name, Path(f"{name}.mcap"), "0" * 64, plant.joints, stamp_ns, measured, None, None,
        stream if commands else None, quality,
    )  # fmt: skip


def saved(recording: Recording, path: Path) -> Path:
    """The recording as a bag that the command line reads."""
    with McapWriter(path) as bag:
        for stamp, row in zip(recording.stamp_ns, recording.position, strict=True):
            bag.joint_states(int(stamp), recording.joints, row)
        if recording.commands is not None:
            for stamp, row in zip(recording.commands.stamp_ns, recording.commands.position, strict=True):
                bag.joint_commands(int(stamp), recording.commands.names, row)
    return path


def worn_finger(twin: TwinModel, path: Path) -> Path:
    """A bag of one finger whose base joint is damped four times as much as the model says."""
    damping = 4.0 * twin.parameter("rh_FFJ3.damping").read(twin.model)
    worn = twin.changed(Terms(parameters={"rh_FFJ3.damping": damping}))
    return saved(recorded(worn, FINGER, np.random.default_rng(8)), path)
