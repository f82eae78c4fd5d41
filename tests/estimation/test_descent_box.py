"""A descent that may go no further than a box, and one across what is rough."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from twin_daemon.estimation.posterior import Posterior
from twin_daemon.estimation.solvers.trust_region import Derivative, descend
from twin_daemon.estimation.thresholds import TOO_STEEP, TRUST_STEP, WIDER_STEPS
from twin_daemon.estimation.variables import ParameterVariable

unit = st.floats(0.0, 1.0)
side = st.tuples(unit, unit).map(sorted)


@given(sides=st.lists(side, min_size=3, max_size=3), slope=st.floats(-3.0, 3.0), aim=st.tuples(unit, unit, unit))
def test_it_ends_at_the_best_point_of_its_box(sides: list[list[float]], slope: float, aim: tuple[float, ...]) -> None:
    """A value that is held to where it may be leaves the others free to make up for it, even if it has no room."""

    def residuals(points: np.ndarray) -> np.ndarray:
        away = points - np.array(aim)
        return np.stack([away[:, 0] + slope * away[:, 1], away[:, 1], away[:, 2]], axis=1)

    variables = [ParameterVariable(name, "1", 0.0, 1.0, 0.5) for name in "abc"]
    problem = cast("Posterior", SimpleNamespace(variables=variables, residuals=residuals))
    low, high = np.array(sides).T
    found = descend(problem, np.array([0.5, 0.5, 0.5]), Derivative(problem, ()), evaluations=60, box=(low, high))
    assert (low - 1e-8 <= found.point).all()
    assert (found.point <= high + 1e-8).all()
    corners = np.random.default_rng(0).uniform(low, high, (500, 3))
    best = float((residuals(corners) ** 2).sum(axis=1).min())
    assert float(found.rows @ found.rows) <= best + 1e-3


@example(amplitude=0.013046886025833846, start=0.4060657195507874)  # chatter that repeats itself in a wide step
@given(amplitude=st.floats(1e-3, 0.02), start=st.floats(0.1, 0.45))
def test_across_what_is_rough_the_slope_is_that_of_what_is_beneath(amplitude: float, start: float) -> None:
    """A law that chatters looks steep to a short step: its value then seems known better than it is."""
    time = np.linspace(0.0, 1.0, 400)

    def residuals(points: np.ndarray) -> np.ndarray:
        chatter = np.sin(1e5 * (points[:, :1] + 1.0) * (time + 1.0))
        return points[:, :1] * time + amplitude * chatter

    variables = [ParameterVariable("a", "1", 0.0, 1.0, 0.5)]
    problem = cast("Posterior", SimpleNamespace(variables=variables, residuals=residuals))
    point = np.array([start])
    short, wide = (
        np.linalg.norm(Derivative(problem, [0], across=across)(point, residuals(point[None])[0]))
        for across in (False, True)
    )
    right = float(np.linalg.norm(time))
    assert abs(wide - right) <= abs(short - right) + 1e-9
    # by the widest step chatter adds so much at most; a narrower one is taken where it is hardly steeper
    widest = right + 2.0 * amplitude * len(time) ** 0.5 / (WIDER_STEPS[-1] * TRUST_STEP)
    assert wide <= TOO_STEEP ** (len(WIDER_STEPS) - 1) * widest


def test_a_ripple_that_two_short_steps_climb_alike_is_seen_past_as_well() -> None:
    period = WIDER_STEPS[-1] * TRUST_STEP
    time = np.linspace(0.0, 1.0, 50)

    def residuals(points: np.ndarray) -> np.ndarray:
        teeth = np.abs((points[:, :1] / period) % 1.0 - 0.5)
        return points[:, :1] * time + teeth * np.cos(30.0 * time)

    variables = [ParameterVariable("a", "1", 0.0, 1.0, 0.5)]
    problem = cast("Posterior", SimpleNamespace(variables=variables, residuals=residuals))
    point = np.array([5.0 * period])
    seen = Derivative(problem, [0], across=True)(point, residuals(point[None])[0])
    assert np.allclose(seen[:, 0], time)
