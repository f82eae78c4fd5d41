"""A comparison says how far the twin is off, and of what sort the error is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.comparison.compare import compare_recording, mean_over_moving, pooled, raw_command_mse
from twin_daemon.comparison.report import comparison_report
from twin_daemon.comparison.split import hold_out
from twin_daemon.errors import BadInput
from twin_daemon.jsonable import plain
from twin_daemon.simulation.alignment import Aligned, align
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

NOISE = 3e-4


@pytest.fixture
def aligned(twin: TwinModel, rng: np.random.Generator) -> Aligned:
    return align(twin, recorded(twin, FINGER, rng, noise_rad=NOISE))


def test_a_perfect_model_is_at_the_noise_floor(twin: TwinModel, aligned: Aligned) -> None:
    report, (comparison,) = comparison_report(twin, [aligned], None)
    assert report["mse_rad2"] == pytest.approx(NOISE**2, rel=0.2)
    assert report["mse_rad2"] < 2.5 * report["noise_floor_rad2"]
    assert report["references"]["raw_command"]["mse_rad2"] > 10 * report["mse_rad2"]
    assert report["references"]["last_promoted"]["mse_rad2"] is None
    assert comparison.residual.shape == aligned.measured.shape


def test_a_shifted_reading_is_bias_and_a_late_one_is_lag(twin: TwinModel, aligned: Aligned) -> None:
    column = twin.joints.index("rh_FFJ3")
    shifted = aligned.measured.copy()
    shifted[:, column] += 0.05
    shifted[:, column] = np.interp(aligned.time_s - 0.04, aligned.time_s, shifted[:, column])
    error = compare_recording(twin, replace(aligned, measured=shifted)).joints["rh_FFJ3"]
    assert error.bias_rad == pytest.approx(0.05, abs=0.01)
    assert error.lag_s == pytest.approx(0.04, abs=0.005)
    assert error.rmse_rad == pytest.approx(np.sqrt(error.mse_rad2))
    assert error.max_abs_rad >= error.rmse_rad


def test_sensors_of_the_twin_are_part_of_its_prediction(twin: TwinModel, rng: np.random.Generator) -> None:
    offset = EffectTerm(effect="sensor_offset", target="rh_FFJ3", values={})
    worn = twin.changed(Terms(effects=(offset,)))
    recording = recorded(worn, FINGER, rng, noise_rad=NOISE)
    with_it, without = (compare_recording(t, align(t, recording)).joints["rh_FFJ3"] for t in (worn, twin))
    assert with_it.mse_rad2 < 2 * NOISE**2
    assert without.mse_rad2 > 100 * NOISE**2


def test_several_recordings_are_pooled_by_their_samples(twin: TwinModel, aligned: Aligned) -> None:
    wrong = replace(aligned, measured=aligned.measured + 0.1)
    good, bad = (compare_recording(twin, r) for r in (aligned, wrong))
    both = pooled([good, bad])["rh_FFJ3"]
    mean = (good.joints["rh_FFJ3"].mse_rad2 + bad.joints["rh_FFJ3"].mse_rad2) / 2
    assert both.mse_rad2 == pytest.approx(mean)
    assert both.max_abs_rad == bad.joints["rh_FFJ3"].max_abs_rad
    assert mean_over_moving({"still": replace(both, moves=False)}) is None


def test_where_nothing_moves_nothing_is_claimed(twin: TwinModel, rng: np.random.Generator) -> None:
    still = align(twin, recorded(twin, {"rh_FFJ3": ([0.0, 1.0], [0.3, 0.3])}, rng, seconds=2.0))
    report, _ = comparison_report(twin, [still], twin)
    assert report["mse_rad2"] is None
    assert report["noise_floor_rad2"] is None
    assert report["references"]["raw_command"]["mse_rad2"] is None
    assert plain(report)["groups"] == {}


def test_the_raw_command_may_lag_as_suits_it(twin: TwinModel, aligned: Aligned) -> None:
    errors = raw_command_mse(twin, aligned)
    assert set(errors) == {"rh_FFJ1", "rh_FFJ2", "rh_FFJ3"}
    later = replace(aligned, onset_s=0.3)
    assert raw_command_mse(twin, later)["rh_FFJ3"] == pytest.approx(errors["rh_FFJ3"], rel=0.05)


def test_blocks_that_are_held_out_and_blocks_that_are_not_make_the_whole(aligned: Aligned) -> None:
    (train,), (held,) = hold_out([aligned])
    seen, hidden = (np.isfinite(part.measured).all(axis=1) for part in (train, held))
    assert np.array_equal(seen, ~hidden)
    assert hidden.mean() == pytest.approx(1 / 3, abs=0.02)
    starts = np.flatnonzero(np.diff(hidden.astype(int)) == 1)
    assert len(starts) >= 2
    assert seen[0]


def test_a_recording_too_short_to_cut_says_so(twin: TwinModel, rng: np.random.Generator) -> None:
    short = align(twin, recorded(twin, FINGER, rng, seconds=2.0))
    with pytest.raises(BadInput, match=r"2.0 s is too short.*at least 3 s.*--holdout"):
        hold_out([short])
