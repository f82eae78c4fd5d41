"""What the tests of the plant share: the hand, and slow triangles that show forces as offsets."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from twin_daemon.hand import Hand, load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.recording import Run, simulate

FF3 = "rh_FFJ3"
KP = 10.0  # N m/rad of that servo in the hand's model
SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand()


Motion = Callable[[float], float]
Drive = Callable[..., Run]


@pytest.fixture(scope="session")
def drive(hand: Hand) -> Drive:
    """drive("backlash:FFJ3=0.05", motion={command: f(t)}, seconds=...) -> what ideal sensors saw."""

    @lru_cache
    def run_once(hidden: tuple[str, ...], motion: tuple[tuple[str, Motion], ...], seconds: float, **how: object) -> Run:
        plant = Plant(hand, hidden=[parse_hidden(text, hand) for text in hidden], ideal_sensors=True)
        return simulate(
            plant,
            lambda t: {name: f(t) for name, f in motion},
            duration_s=seconds,
            **how,  # type: ignore[arg-type]
        )

    def run(*hidden: str, motion: Mapping[str, Motion], seconds: float, **how: object) -> Run:
        return run_once(hidden, tuple(motion.items()), seconds, **how)

    return run


@lru_cache  # the same motion is the same object, and its run is made once
def ramp(start: float, speed: float, begin: float = 0.0) -> Motion:
    return lambda t: start + speed * max(t - begin, 0.0)


@lru_cache
def step(start: float, end: float, at: float = 0.1) -> Motion:
    return lambda t: end if t >= at else start


def triangle(low: float, high: float, leg_s: float) -> Motion:
    """Up and down again, once."""
    return lambda t: float(np.interp(t, [0.0, leg_s, 2 * leg_s], [low, high, low]))


def width(run: Run, at: float, command: Motion, seconds: float, joint: str = FF3) -> float:
    """rad by which the way down lies above the way up where the command passes `at`: the width of the loop."""
    told = np.array([command(t) for t in run.time_s])
    half = run.time_s < seconds / 2
    q = run.column(joint)
    up = np.interp(at, told[half], q[half])
    down = np.interp(at, told[~half][::-1], q[~half][::-1])
    return float(down - up)
