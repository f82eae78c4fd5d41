"""The measured motion of a robot: where it was, also where its commands were late."""

from __future__ import annotations

import numpy as np
import pytest

from tests.simulation.made import Motion, recorded
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.prescribed import measured_motion
from twin_daemon.simulation.twin import TwinModel

_STEPS: Motion = {"rh_FFJ3": ([0, 0.999, 1.0, 1.999, 2.0, 2.999, 3.0, 4.0], [0.2, 0.2, 1.0, 1.0, 0.4, 0.4, 0.9, 0.9])}


@pytest.mark.parametrize("late_s", [0.0, 0.004, 0.03])
def test_a_late_command_moves_the_whole_prediction(twin: TwinModel, late_s: float, rng: np.random.Generator) -> None:
    """A step of a command is sharp: half a sample of delay would be a jump of torque for every neighbour."""
    read = align(twin, recorded(twin, _STEPS, rng, seconds=4.0, noise_rad=1e-5))
    column = twin.joints.index("rh_FFJ3")
    stirring = np.array([name == "rh_FFJ3" for name in twin.joints])
    on_time = measured_motion(twin, read, stirring)
    late = measured_motion(twin, read.with_onset(read.onset_s - late_s), stirring)
    fastest = np.abs(on_time.acceleration[:, column]).max()
    assert np.abs(late.acceleration - on_time.acceleration)[:, column].max() < 0.1 * fastest


def test_noise_is_averaged_as_long_as_a_right_prediction_allows(twin: TwinModel, rng: np.random.Generator) -> None:
    """Over no more than the time of its servo a milliradian of noise is 1.1 rad/s^2 of this joint."""
    stirring = np.array([name == "rh_FFJ3" for name in twin.joints])
    quiet, noisy = (
        measured_motion(twin, align(twin, recorded(twin, _STEPS, rng, seconds=16.0, noise_rad=noise)), stirring)
        for noise in (1e-6, 1e-3)
    )
    assert (noisy.acceleration - quiet.acceleration)[:, twin.joints.index("rh_FFJ3")].std() < 0.7
