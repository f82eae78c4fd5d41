"""What a sensor's own noise is, read off a recording in which the hand moves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.recordings.noise import noise_variance, resolution

TIME_S = np.arange(1600) / 125.0
MOTION = np.interp(TIME_S, [0, 2, 5, 7, 10, 12.8], [0.0, 0.0, 1.5, 1.5, 0.2, 0.2])


@pytest.mark.parametrize("sigma", [1e-5, 3e-4, 2e-3])
def test_planted_noise_is_recovered_under_a_motion(sigma: float, rng: np.random.Generator) -> None:
    found = noise_variance(MOTION + sigma * rng.standard_normal(MOTION.size))
    # the quiet half of noise alone is a little quieter than the noise
    assert 0.6 * sigma < np.sqrt(found) < 1.15 * sigma


@pytest.mark.parametrize("rate_hz", [50.0, 100.0])
def test_a_fast_motion_that_is_sampled_slowly_is_no_noise(rate_hz: float, rng: np.random.Generator) -> None:
    time_s = np.arange(0.0, 20.0, 1.0 / rate_hz)
    motion = 0.5 * np.sin(2 * np.pi * 1.5 * time_s) + 0.2 * np.sin(2 * np.pi * 0.4 * time_s)
    found = noise_variance(motion + 3e-4 * rng.standard_normal(motion.size))
    assert 0.6 * 3e-4 < np.sqrt(found) < 1.3 * 3e-4  # eighty times that by differences of the second order, at 50 Hz


def test_a_sensor_that_counts_has_the_noise_of_its_step() -> None:
    step = 1.3e-3
    assert resolution(np.round(MOTION / step) * step) == pytest.approx(step)
    assert noise_variance(np.full(400, step) * (np.arange(400) > 200)) >= 0.99 * step**2 / 12


@given(st.lists(st.floats(-3, 3) | st.just(float("nan")), max_size=60))
def test_it_is_a_variance_of_anything(values: list[float]) -> None:
    found = noise_variance(np.array(values, float))
    assert np.isfinite(found)
    assert found >= 0.0
