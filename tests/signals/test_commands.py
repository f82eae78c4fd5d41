"""What was commanded, at any time."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from twin_daemon.recordings.recording import Commands
from twin_daemon.signals.commands import CommandSignal

MS = 1_000_000
targets = st.floats(-3.0, 3.0, allow_nan=False) | st.just(float("nan"))
streams = st.lists(st.tuples(st.integers(1, 500), targets, targets), min_size=1, max_size=30)


def stream(rows: list[tuple[int, float, float]], interpolation: str = "hold") -> Commands:
    stamps = np.cumsum([row[0] for row in rows]).astype(np.int64) * MS
    return Commands(stamps, ("a", "b"), np.array([row[1:] for row in rows]), interpolation)  # type: ignore[arg-type]


@given(streams, st.floats(-1.0, 20.0))
def test_a_held_target_is_the_last_one_that_was_sent(rows: list[tuple[int, float, float]], time_s: float) -> None:
    commands = stream(rows)
    sampled = CommandSignal.from_stream(commands, 0).sample(np.array([time_s]))[0]
    sent = commands.stamp_ns * 1e-9 <= time_s + 1e-7
    for column in range(2):
        # before the first message the first one stands
        known = commands.position[sent if sent.any() else np.arange(len(rows)) == 0, column]
        known = known[np.isfinite(known)]
        expected = known[-1] if known.size else np.nan
        np.testing.assert_equal(sampled[column], expected)


@given(st.lists(st.tuples(st.integers(1, 500), st.floats(-3, 3), st.floats(-3, 3)), min_size=2, max_size=20))
def test_a_line_goes_through_its_points_and_stays_between_them(rows: list[tuple[int, float, float]]) -> None:
    commands = stream(rows, "linear")
    signal = CommandSignal.from_stream(commands, 0)
    np.testing.assert_allclose(signal.sample(commands.stamp_ns * 1e-9), commands.position, atol=1e-6)
    times = np.linspace(-1.0, commands.stamp_ns[-1] * 1e-9 + 1.0, 50)
    sampled = signal.sample(times)
    assert (sampled >= commands.position.min(axis=0) - 1e-9).all()
    assert (sampled <= commands.position.max(axis=0) + 1e-9).all()
    np.testing.assert_equal(sampled[0], commands.position[0])
    np.testing.assert_equal(sampled[-1], commands.position[-1])


def test_a_stamp_a_rounding_error_late_still_belongs_to_its_step() -> None:
    signal = CommandSignal(("a",), np.array([0.0, 0.1 + 1e-9]), np.array([[1.0], [2.0]]), "hold")
    assert signal.sample(np.array([0.1]))[0, 0] == 2.0


@given(streams, st.floats(0.0, 10.0), st.sampled_from([0.002, 0.05]))
def test_the_mean_of_a_held_target_is_that_of_its_samples(
    rows: list[tuple[int, float, float]], time_s: float, width_s: float
) -> None:
    signal = CommandSignal.from_stream(stream(rows), 0)
    mean = signal.mean(np.array([time_s]), width_s)[0]
    fine = signal.sample(time_s + width_s * (np.arange(4000) + 0.5 - 2000) / 4000)
    for column in range(2):
        if np.isfinite(fine[:, column]).all():
            assert abs(mean[column] - fine[:, column].mean()) < 0.01
