"""What an earlier fit knows holds the values that a recording does not show, and follows those that have changed."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.simulation.made import FINGER, recorded
from twin_daemon.calibration.calibrate import Calibration, calibrate
from twin_daemon.calibration.spaces import load_space
from twin_daemon.estimation.thresholds import Z95
from twin_daemon.estimation.variables import Prior, Remembered
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions.trend import USUAL_SPREAD

WORN = {"rh_FFJ3.damping": 1.6, "rh_FFJ0.kp": 0.8, "rh_FFJ3.frictionloss": 1.5}


def real(twin: TwinModel, factors: Mapping[str, float]) -> TwinModel:
    values = {name: factor * twin.parameter(name).read(twin.model) for name, factor in factors.items()}
    return twin.changed(Terms(parameters=values))


def fitted(twin: TwinModel, hand: TwinModel, seed: int, remembered: Mapping[str, Remembered] | None) -> Calibration:
    recording = align(twin, recorded(hand, FINGER, np.random.default_rng(seed)))
    return calibrate(twin, [recording], [], load_space("wear"), "least-squares", remembered=remembered)


@pytest.fixture(scope="module")
def yesterday(twin: TwinModel) -> tuple[TwinModel, dict[str, Remembered]]:
    found = fitted(twin, real(twin, WORN), 1, None)
    known = {
        name: Remembered(one.value, math.hypot((one.ci95[1] - one.ci95[0]) / (2.0 * Z95), USUAL_SPREAD * one.value))
        for name, one in found.parameters.items()
    }
    return twin.changed(found.terms), known


@pytest.mark.slow
def test_offsets_that_only_their_sum_shows_are_not_made_up(
    twin: TwinModel, yesterday: tuple[TwinModel, dict[str, Remembered]]
) -> None:
    before, known = yesterday
    free, held = (fitted(before, real(twin, WORN), 2, one) for one in (None, known))
    offset = "sensor_offset:rh_FFJ1.offset"
    assert abs(free.parameters[offset].value) > 0.01  # rad; there is none
    assert abs(held.parameters[offset].value) < 0.002
    assert held.after_rad2 == pytest.approx(free.after_rad2, rel=0.05)


@pytest.mark.parametrize(("name", "factor"), [("rh_FFJ3.damping", 1.4), ("rh_FFJ0.kp", 0.75)])
def test_what_has_changed_is_followed_all_the_way(
    twin: TwinModel, yesterday: tuple[TwinModel, dict[str, Remembered]], name: str, factor: float
) -> None:
    before, known = yesterday
    hand = real(twin, {**WORN, name: WORN[name] * factor})
    found = fitted(before, hand, 3, known)
    assert found.parameters[name].value == pytest.approx(hand.parameter(name).read(hand.model), rel=0.03)


@given(st.floats(0.01, 0.3), st.floats(0.4, 1.0), st.floats(-1.0, 1.0))
def test_a_remembered_value_is_near_or_has_changed(sigma: float, changed: float, mean: float) -> None:
    prior = Prior(mean, sigma, changed)
    positions = mean + np.linspace(-3.0, 3.0, 601)
    missed = prior.missed(positions)
    assert missed[300] == pytest.approx(0.0, abs=1e-6)
    assert (np.diff(missed) > 0.0).all()
    assert np.allclose(missed, -missed[::-1], atol=1e-6)
    assert (np.abs(missed) <= np.abs(Prior(mean, sigma).missed(positions)) + 1e-6).all()
    # far off it costs what the wider belief does, and the price of a change
    slab = Prior(mean, changed).missed(positions)
    price = 2.0 * np.log((0.9 / sigma + 0.1 / changed) / (0.1 / changed))
    assert missed[-1] ** 2 == pytest.approx(slab[-1] ** 2 + price, rel=0.02)
