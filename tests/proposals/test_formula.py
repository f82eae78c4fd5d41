"""A curve gets the formula that describes it shortest, with values in their usual ranges."""

from __future__ import annotations

import numpy as np
import pytest

from twin_daemon.proposals.features import Feature
from twin_daemon.proposals.formula import dense, formulas


def _feature(over: str, knots: np.ndarray) -> Feature:
    return Feature("torque", over, tuple(knots), "N m", 1.0, neighbour="next" if over == "neighbour" else "")


def _best(over: str, knots: np.ndarray, curve: np.ndarray):
    noisy = curve + 0.002 * np.random.default_rng(3).standard_normal(len(curve))
    return formulas(_feature(over, knots), noisy, np.full(len(curve), 0.003))[0]


ANGLES = np.linspace(-0.9, 1.1, 22)
ERRORS = np.array([-0.3, -0.15, -0.075, -0.03, -0.01, 0.0, 0.01, 0.03, 0.075, 0.15, 0.3])


@pytest.mark.parametrize(
    ("key", "over", "knots", "curve"),
    [
        ("sine", "position", ANGLES, 0.05 * np.sin(9.0 * ANGLES + 0.7)),
        ("line", "position", ANGLES, 0.1 - 0.2 * ANGLES),
        ("constant", "position", ANGLES, np.full_like(ANGLES, 0.1)),
        ("cubic", "position", ANGLES, -0.2 * ANGLES - 0.4 * ANGLES**3),
        ("above", "position", ANGLES, -0.8 * np.maximum(ANGLES - 0.75, 0.0)),
        ("below", "position", ANGLES, 0.8 * np.maximum(-0.5 - ANGLES, 0.0)),
        ("proportional", "velocity", ERRORS, -0.8 * ERRORS),
        ("bump", "position", ANGLES, 0.3 * np.exp(-(((ANGLES - 0.2) / 0.3) ** 2))),
        ("settling", "time", np.linspace(0.0, 20.0, 8), -0.6 * (1.0 - np.exp(-np.linspace(0.0, 20.0, 8) / 4.0))),
        ("power", "velocity", ERRORS, -0.8 * ERRORS * np.abs(ERRORS)),
        ("dead_zone", "error", ERRORS, -np.clip(ERRORS, -0.03, 0.03)),
        ("sides", "error", ERRORS, np.where(ERRORS > 0.0, 0.3, -0.1) * ERRORS),
    ],
)
def test_a_curve_gets_its_formula(key: str, over: str, knots: np.ndarray, curve: np.ndarray) -> None:
    assert _best(over, knots, curve).family.key == key


def test_a_sine_has_a_positive_size_and_a_phase_within_half_a_turn() -> None:
    amplitude, waves, phase, _ = _best("position", ANGLES, -0.05 * np.sin(9.0 * ANGLES + 0.7)).values
    assert amplitude == pytest.approx(0.05, rel=0.1)
    assert waves == pytest.approx(9.0, rel=0.02)
    assert phase == pytest.approx(0.7 - np.pi, abs=0.1)


def test_a_constant_beside_a_factor_is_no_law_of_the_variable() -> None:
    feature = Feature("command", "position", tuple(ANGLES), "1", 1.0, factor="error")
    found = formulas(feature, np.full(len(ANGLES), 0.1), np.full(len(ANGLES), 0.003))
    assert "constant" not in {one.family.key for one in found}


def test_a_memory_has_no_formula() -> None:
    feature = Feature("torque", "velocity", (0.1, 1.0), "N m/rad", 1.0, memory="relaxation")
    assert formulas(feature, np.array([0.1, 0.2]), np.array([0.1, 0.1])) == []


@pytest.mark.parametrize("over", ["position", "velocity", "time", "error"])
def test_dense_knots_increase_and_cover_what_was_visited(over: str) -> None:
    knots = ERRORS if over in ("velocity", "error") else np.linspace(0.0, 2.0, 9)
    found = np.array(dense(_feature(over, knots), (float(knots[0]), float(knots[-1]))))
    assert (np.diff(found) > 0.0).all()
    assert found[0] <= knots[0]
    assert found[-1] >= knots[-1]


def test_a_formula_is_validated_wherever_that_motion_goes() -> None:
    knots = np.linspace(0.5, 2.0, 9)
    assert dense(_feature("position", knots), (0.4, 1.9))[0] > 0.0
    beyond = dense(_feature("position", knots), (-1.0, 3.0))
    assert (beyond[0], beyond[-1]) == (-1.0, 3.0)
