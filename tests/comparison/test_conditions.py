"""The residual apart by what a joint was doing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.comparison.conditions import CONDITIONS, conditions, errors_by_condition
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.twin import TwinModel

TIME_S = np.arange(0.0, 8.0, 0.008)


def test_a_ramp_up_a_hold_and_a_ramp_down_are_told_apart() -> None:
    position = np.interp(TIME_S, [0, 2, 4, 6, 8], [0.0, 1.0, 1.0, 0.2, 0.2])
    masks = conditions(TIME_S, position)
    assert tuple(masks) == CONDITIONS
    assert masks["moving up"][TIME_S < 1.9].all()
    assert masks["hold"][(TIME_S > 2.2) & (TIME_S < 3.8)].all()
    assert masks["moving down"][(TIME_S > 4.2) & (TIME_S < 5.8)].all()
    thirds = sum(masks[name].astype(int) for name in CONDITIONS if "third" in name)
    assert (thirds == 1).all()


def test_a_reversal_counts_for_a_quarter_of_a_second_even_after_a_hold() -> None:
    position = np.interp(TIME_S, [0, 2, 4, 6, 8], [0.0, 1.0, 1.0, 0.2, 0.2])
    after = TIME_S[conditions(TIME_S, position)["just after a reversal"]]
    assert after[0] == pytest.approx(4.0, abs=0.1)
    assert after[-1] - after[0] == pytest.approx(0.25, abs=0.02)


def test_samples_that_are_missing_change_no_direction() -> None:
    position = TIME_S * 0.2
    position[100:200] = np.nan
    assert conditions(TIME_S, position)["moving up"][10:-10].all()


def test_the_worst_moment_and_its_recording_are_known(twin: TwinModel, rng: np.random.Generator) -> None:
    first, second = (align(twin, recorded(twin, FINGER, rng)) for _ in range(2))
    column = first.joints.index("rh_FFJ3")
    at = int(np.argmax(conditions(second.time_s, second.measured[:, column])["hold"]))
    errors = errors_by_condition([(first, first.measured), (second, off_by(second, at, column))])
    found = next(e for e in errors if (e.joint, e.condition) == ("rh_FFJ3", "hold"))
    assert (found.worst_in, found.worst_s) == (1, pytest.approx(second.time_s[at]))
    assert found.times_average > 1.0
    assert errors[0].rmse_rad == max(e.rmse_rad for e in errors)


def off_by(aligned: Aligned, sample: int, column: int) -> np.ndarray:
    predicted = aligned.measured.copy()
    predicted[sample, column] += 0.5
    return predicted


def test_joints_that_stand_still_are_left_out(twin: TwinModel, rng: np.random.Generator) -> None:
    aligned = align(twin, recorded(twin, FINGER, rng))
    still = replace(aligned, measured=np.full_like(aligned.measured, 0.1))
    assert errors_by_condition([(still, still.measured)]) == []
