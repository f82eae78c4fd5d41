"""When readings were taken: on the clock of a robot, or at their stamps, as the readings themselves tell."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin_daemon.recordings.sampling_clock import sample_times

_RATE_HZ, _NOISE_RAD = 100.0, 1e-4


def _angles(time_s: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(n, 2) rad that two joints in motion read at such times (n,)."""
    motion = [0.5 * np.sin(2.0 * np.pi * 0.7 * time_s), 0.3 * np.sin(2.0 * np.pi * 1.9 * time_s + 1.0)]
    return np.column_stack(motion) + _NOISE_RAD * random.standard_normal((len(time_s), 2))


def _clock(samples: int) -> np.ndarray:
    return np.arange(samples) / _RATE_HZ


@given(seed=st.integers(0, 1000), jitter_s=st.floats(3e-4, 1.5e-3))
@settings(max_examples=20, deadline=None)
def test_late_stamps_are_put_back_on_the_clock(seed: int, jitter_s: float) -> None:
    random = np.random.default_rng(seed)
    clock = _clock(2000)
    late = jitter_s * random.standard_normal(len(clock))
    found = sample_times(clock + late, _angles(clock, random))
    assert found.sigma_s is not None
    off = found.time_s - clock
    assert np.std(off) < 0.2 * jitter_s
    assert found.sigma_s < 0.2 * jitter_s


@given(seed=st.integers(0, 1000), jitter_s=st.floats(3e-4, 1.5e-3))
@settings(max_examples=20, deadline=None)
def test_stamps_that_say_when_a_reading_was_taken_stay(seed: int, jitter_s: float) -> None:
    random = np.random.default_rng(seed)
    stamps = _clock(2000) + jitter_s * random.standard_normal(2000)
    found = sample_times(stamps, _angles(stamps, random))
    assert np.std(found.time_s - stamps) < 0.1 * jitter_s
    assert found.sigma_s is not None
    assert found.sigma_s < 0.35 * jitter_s


def test_what_is_off_by_both_is_known_no_better_than_that() -> None:
    random = np.random.default_rng(3)
    taken = _clock(4000) + 7e-4 * random.standard_normal(4000)
    stamps = taken + 7e-4 * random.standard_normal(4000)
    found = sample_times(stamps, _angles(taken, random))
    assert found.sigma_s == pytest.approx(np.std(found.time_s - taken), rel=0.15)
    assert np.std(found.time_s - taken) < 0.8 * np.std(stamps - taken)


def test_missing_samples_and_a_clock_that_wanders_leave_the_others_where_they_were() -> None:
    random = np.random.default_rng(4)
    kept = np.delete(np.arange(3000), [*range(400, 403), 1500, *range(2000, 2050)])
    taken = kept / _RATE_HZ * (1.0 + 1e-5) + 1e-3 * np.sin(kept / 600.0)
    stamps = taken + 1e-3 * random.standard_normal(len(kept))
    found = sample_times(stamps, _angles(taken, random))
    assert np.std(found.time_s - taken) < 0.2e-3
    assert np.abs(found.time_s - taken).max() < 0.7e-3


@pytest.mark.parametrize("case", ["still", "no clock", "short", "regular"])
def test_where_nothing_tells_the_stamps_are_what_counts(case: str) -> None:
    random = np.random.default_rng(5)
    clock = _clock(90 if case == "short" else 2000)
    jitter = {"no clock": 8e-3, "regular": 0.0}.get(case, 1e-3)
    stamps = np.sort(clock + jitter * random.standard_normal(len(clock)))
    angles = _angles(clock, random)
    if case == "still":
        angles = _NOISE_RAD * random.standard_normal(angles.shape)
    found = sample_times(stamps, angles)
    assert found.sigma_s is None
    assert found.time_s is stamps


@pytest.mark.parametrize("rate_hz", [2.0, 1e4, 1e6])
@pytest.mark.parametrize("samples", [2, 101, 140])
def test_recordings_of_any_rate_and_length_are_taken(rate_hz: float, samples: int) -> None:
    random = np.random.default_rng(6)
    stamps = (np.arange(samples) + 0.1 * random.standard_normal(samples)) / rate_hz
    found = sample_times(stamps, _angles(stamps, random))
    assert found.time_s.shape == stamps.shape
    assert (np.diff(found.time_s) > 0.0).all()
