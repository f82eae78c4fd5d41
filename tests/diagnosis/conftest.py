"""Recordings of a plant that shares no code with the library, on one joint so that they are quick to diagnose."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from twin_daemon.cli.app import main
from twin_daemon.hand import Hand, load_hand
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.plant.motions import rich
from twin_daemon.plant.recording import record
from twin_daemon.signals.trajectory import Trajectory
from twin_daemon.simulation.twin import TwinModel

GAP_RAD = 0.025
FACTOR = 1.1
JOINT = "rh_FFJ3"


@pytest.fixture(scope="session")
def hand() -> Hand:
    return load_hand()


@pytest.fixture(scope="session")
def twin(hand: Hand) -> TwinModel:
    return TwinModel.load(hand)


@pytest.fixture(scope="session")
def recorded(hand: Hand, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """A bag of a plant whose parameters are up to 20 % off the nominal ones, with or without a hidden effect."""
    folder = tmp_path_factory.mktemp("bags")

    def make(name: str, motion: Trajectory, *hidden: str, seed: int = 1) -> Path:
        path = folder / f"{name}.mcap"
        plant = Plant(hand, seed=5, hidden=[parse_hidden(text, hand) for text in hidden], spread=0.2)
        record(plant, motion, path, jitter_s=0.0005, seed=seed)
        return path

    return make


@pytest.fixture(scope="session")
def misread(recorded: Callable[..., Path], hand: Hand) -> tuple[Path, Path]:
    """(to fit, held out): a joint whose sensor reads a tenth too much. Few candidates come near, so it is quick."""
    hidden = f"sensor_gain:{JOINT}={FACTOR}"
    return (
        recorded("misread_fit", rich(hand, [JOINT], 7.0, 1), hidden, seed=1),
        recorded("misread_held", rich(hand, [JOINT], 7.0, 2), hidden, seed=2),
    )


@pytest.fixture(scope="session")
def played(recorded: Callable[..., Path], hand: Hand) -> Path:
    """A joint with play in its transmission."""
    return recorded("play", rich(hand, [JOINT], 8.0, 1), f"backlash:{JOINT}={GAP_RAD}")


@pytest.fixture(scope="session")
def sound(recorded: Callable[..., Path], hand: Hand) -> Path:
    """The same joint with nothing but parameters that are off."""
    return recorded("sound", rich(hand, [JOINT], 8.0, 1))


@pytest.fixture(scope="session")
def still(recorded: Callable[..., Path], hand: Hand) -> Path:
    """Four seconds in which nothing moves."""
    import numpy as np

    return recorded("still", Trajectory("still", (JOINT,), np.array([0.0, 4.0]), np.full((2, 1), 0.3)))


def called(*argv: str, result: Path) -> dict[str, Any]:
    """What a command that must succeed wrote; strict JSON."""
    assert main([*argv, "--json", str(result)]) == 0

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} in the JSON")

    content = json.loads(result.read_text(encoding="utf-8"), parse_constant=refuse)
    assert content["schema"] == 1
    return content


def said_of_case(seed: int, folder: Path) -> dict[str, Any]:
    """What is said of a development case of the hidden suite."""
    export = ["-m", "bench.random_robots", "--export", str(folder), "--seed", str(seed), "--count", "1"]
    subprocess.run([sys.executable, *export], check=True, timeout=120, stdout=subprocess.DEVNULL)
    case = folder / f"case_{seed}"
    return called("diagnose", "--model", f"{case}.xml", "--recording", f"{case}_fit", "--holdout", f"{case}_holdout",
                  result=folder / "d.json")  # fmt: skip
