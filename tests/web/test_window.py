"""The last seconds of the live charts, with hours of data through them, compressed in time."""

from __future__ import annotations

import numpy as np
import pytest

from twin_daemon.web.window import KEPT_S, Piece, Window

START_NS = 1_700_000_000_000_000_000
JOINTS = ["a"]


def played(window: Window, first: int, count: int, rate_hz: float, start_ns: int = START_NS) -> None:
    """Samples number `first` and after; what is measured is the number itself, and the twin is 1 below."""
    step_ns, values = round(1e9 / rate_hz), np.arange(first - 1.0, first + count)[:, None]
    for number in range(first, first + count):
        stamp_ns = start_ns + number * step_ns
        window.measured(stamp_ns, JOINTS, values[number - first + 1])
        window.predicted(stamp_ns, JOINTS, values[number - first])


@pytest.mark.parametrize(("rate_hz", "seconds"), [(10.0, 3 * 3600), (1000.0, 60)])
def test_times_are_those_of_the_stamps_for_hours(rate_hz: float, seconds: int) -> None:
    window, cursor, seen = Window(JOINTS), 0, -1.0
    piece = int(rate_hz * seconds / 30)
    for first in range(0, int(rate_hz * seconds), piece):
        played(window, first, piece, rate_hz)
        found = window.after(cursor)
        cursor = found.cursor
        assert found.base_ns == START_NS
        assert np.all(np.diff(found.time_s) > 0)
        assert found.time_s[0] > seen
        seen = float(found.time_s[-1])
        assert found.measured[:, 0] == pytest.approx(found.time_s * rate_hz), "each sample at its own time"
        assert np.ptp(found.time_s) <= KEPT_S
        assert window.rms_rad() == pytest.approx([1.0])
    assert seen > seconds - KEPT_S


def test_stamps_that_start_again_begin_anew() -> None:
    window = Window(JOINTS)
    played(window, 0, 20_000, 1000.0)
    cursor = window.after(0).cursor
    played(window, 0, 10, 1000.0, start_ns=START_NS - 5_000_000_000)
    again: Piece = window.after(cursor)
    assert again.fresh
    assert again.base_ns == START_NS - 5_000_000_000
    assert again.time_s[0] == 0.0
