"""A twin of the Shadow Hand and clocks that tests move by hand."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.service import TwinService
from twin_daemon.daemon.settings import DaemonSettings
from twin_daemon.hand import load_hand
from twin_daemon.simulation.twin import TwinModel

START_NS = 1_700_000_000_000_000_000


class Clock:
    """A clock that stands still until it is moved."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s

    def wall_ns(self) -> int:
        return START_NS + int((self.now_s - 100.0) * 1e9)


@pytest.fixture(scope="session")
def twin() -> TwinModel:
    return TwinModel.load(load_hand())


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def make_service(twin: TwinModel, clock: Clock) -> Callable[..., TwinService]:
    def make(**settings: Any) -> TwinService:
        return TwinService(
            twin, {"id": "nominal"}, DaemonSettings(**settings), monotonic_s=clock, wall_ns=clock.wall_ns
        )

    return make


@pytest.fixture
def joint_state(twin: TwinModel) -> Callable[..., JointSample]:
    """A message with every joint at `position`, or a partial one, `time_s` after the start."""

    def make(time_s: float, position: object = 0.1, names: tuple[str, ...] | None = None) -> JointSample:
        names = twin.joints if names is None else names
        values = np.broadcast_to(np.asarray(position, float), (len(names),)).copy()
        return JointSample(START_NS + round(time_s * 1e9), names, values)

    return make
