"""One recalibration: what it does with its time, and with somebody who ends it."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.recalibration.recalibrate import recalibrate
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel


@pytest.fixture
def worn(twin: TwinModel) -> list[Aligned]:
    """Two recordings of a finger whose base joint has become stiff."""
    damping = 6.0 * twin.parameter("rh_FFJ3.damping").read(twin.model)
    real = twin.changed(Terms(parameters={"rh_FFJ3.damping": damping}))
    return [align(twin, recorded(real, FINGER, np.random.default_rng(seed))) for seed in (5, 6)]


def test_the_values_of_a_worn_finger_are_followed_within_the_time(twin: TwinModel, worn: list[Aligned]) -> None:
    found = recalibrate(twin, worn[:1], worn[1:], joints=["rh_FFJ3"], seconds=4.0)
    assert found.decision.better
    assert found.decision.gain > 0.9
    assert found.appeared == ()
    assert found.parameters["rh_FFJ3.damping"].value > 3.0 * twin.parameter("rh_FFJ3.damping").read(twin.model)


def test_whoever_ends_it_ends_the_whole_of_it_and_keeps_the_best(twin: TwinModel, worn: list[Aligned]) -> None:
    said: list[str] = []
    ended = 0

    def stop(count: int, _: float) -> None:
        nonlocal ended
        if count >= 12:
            ended += 1
            raise KeyboardInterrupt

    found = recalibrate(twin, worn[:1], worn[1:], joints=["rh_FFJ3"], progress=stop, say=said.append)
    assert ended == 1
    assert len(said) == 1
    assert found.calibration.interrupted
    assert found.ladder is None
    assert found.calibration.after_rad2 <= found.calibration.before_rad2
