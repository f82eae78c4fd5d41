"""What a right model leaves: the noise of a sensor, and what the jitter of its stamps makes of the joint's speed."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.rig import rig_model
from tests.simulation.made import Motion, recorded
from twin_daemon.estimation.floor import floor_variance
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.twin import TwinModel

_JITTER_S, _NOISE_RAD = 2e-4, 2e-5


def _turning(piece: Aligned, column: int, speed: float, rng: np.random.Generator) -> Aligned:
    """The piece with a joint that turns to and fro at a speed in rad/s, read a little early or late."""
    true_s = piece.time_s
    stamps = true_s + _JITTER_S * rng.standard_normal(len(true_s))
    measured = piece.measured.copy()
    angle = speed / 6.0 * np.sin(6.0 * true_s)
    measured[:, column] = angle + _NOISE_RAD * rng.standard_normal(len(true_s))
    return replace(piece, time_s=stamps, measured=measured)


@pytest.mark.parametrize("speeds", [(0.3, 0.3, 0.3), (0.3, 0.3, 8.0)])
def test_what_jitter_leaves_of_the_fastest_piece_is_in_the_floor(
    speeds: tuple[float, ...], tmp_path: Path, rng: np.random.Generator
) -> None:
    twin = TwinModel.load(load_hand(model=rig_model(tmp_path)))
    motion: Motion = {"left": ([0.0, 6.0], [0.0, 0.3])}
    piece = align(twin, recorded(twin, motion, rng, seconds=6.0))
    column = piece.joints.index("left")
    pieces = [_turning(piece, column, speed, rng) for speed in speeds]
    (floor,) = floor_variance(pieces, ["left"])
    # what a model leaves that is right to the last digit, at the stamps that it is given
    errors = [
        p.measured[:, column] - speed / 6.0 * np.sin(6.0 * p.time_s) for p, speed in zip(pieces, speeds, strict=True)
    ]
    left = float(np.mean(np.concatenate(errors) ** 2))
    assert left / 2.0 < floor < 2.0 * left


def test_a_coarse_sensor_that_mostly_rests_on_one_count_is_not_exact(tmp_path: Path, rng: np.random.Generator) -> None:
    count_rad = 2.0 * np.pi / 4096
    twin = TwinModel.load(load_hand(model=rig_model(tmp_path)))
    motion: Motion = {"left": ([0.0, 6.0], [0.0, 0.3])}
    piece = align(twin, recorded(twin, motion, rng, seconds=6.0))
    column = piece.joints.index("left")

    def read(angle: np.ndarray) -> Aligned:
        measured = piece.measured.copy()
        measured[:, column] = count_rad * np.round(angle / count_rad)
        return replace(piece, measured=measured)

    moving, still = read(0.2 * np.sin(piece.time_s)), read(np.full(len(piece.time_s), 0.3))
    (floor,) = floor_variance([still, moving, still, still], ["left"])
    assert 0.99 * count_rad**2 / 12.0 < floor < 4.0 * count_rad**2 / 12.0
