"""Recordings of a small arm with a law at its elbow that no effect of the library describes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from bench.foreign_laws import LAWS, arm_model, pair, record
from twin_daemon.diagnosis.verdict import Diagnosis
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.twin import TwinModel

UNEXPLAINED = Diagnosis.without_findings("unexplained", "no effect of the library fits")


@pytest.fixture(scope="session")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The nominal model."""
    return arm_model(tmp_path_factory.mktemp("arm"))


@pytest.fixture(scope="session")
def twin(arm: Path) -> TwinModel:
    return TwinModel.load(load_hand(model=arm))


@pytest.fixture(scope="session")
def bags(arm: Path) -> Callable[[str, float, float], tuple[Path, Path]]:
    """(a bag to fit, a bag of other and faster motion) of the arm with a law or two (`one+other`), so long."""

    def make(law: str, seconds: float, held_s: float) -> tuple[Path, Path]:
        found = (arm.parent / f"{law}_fit.mcap", arm.parent / f"{law}_held.mcap")
        if not found[0].exists():
            one, _, other = law.partition("+")
            at_work = pair(LAWS[one], LAWS[other]) if other else LAWS[one]
            record(at_work, found[0], seconds=seconds, seed=1)
            record(at_work, found[1], seconds=held_s, seed=2, fastest=1.5)
        return found

    return make


@pytest.fixture(scope="session")
def recorded(twin: TwinModel, bags: Callable[..., tuple[Path, Path]]) -> Callable[..., list[list[Aligned]]]:
    """The same, aligned to the twin."""

    def make(law: str, seconds: float, held_s: float) -> list[list[Aligned]]:
        return [[align(twin, load_recording(path))] for path in bags(law, seconds, held_s)]

    return make
