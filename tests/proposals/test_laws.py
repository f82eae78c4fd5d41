"""What a law does in roll-outs is what the model's own element of the same kind does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.library_laws import ANSWERS
from twin_daemon.effects import BUILT_IN
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.hand import load_hand
from twin_daemon.proposals.features import OF_NEIGHBOURS, Feature, features
from twin_daemon.proposals.law_problem import GivenLaw, LawProblem
from twin_daemon.proposals.track import Track, orientation, track
from twin_daemon.simulation.terms import EffectTerm
from twin_daemon.simulation.twin import TwinModel

Recorded = Callable[[str, float, float], list[list[Any]]]
FLOOR = np.array([1e-6])
SPEEDS = (-2.0, -0.1, 0.1, 2.0)


def moved(
    twin: TwinModel, train: Any, feature: Feature | None, values: list[float], given: tuple[GivenLaw, ...] = ()
) -> list[np.ndarray]:
    """Predicted readings (n,) of the elbow with a law beside others, by piece."""
    actuator = twin.actuators.index("elbow")
    tracks = [track(twin, twin, one, "elbow", actuator, []) for one in train]
    problem = LawProblem(
        twin, train, (), ["elbow"], FLOOR, feature=feature, joint="elbow", actuator=actuator, tracks=tracks, given=given
    )
    found = problem.predict(problem.point(np.zeros(0), np.array(values))[None])
    return [one[0, :, 0] for one in found]


def with_own(twin: TwinModel, train: Any, parameter: str, more: float) -> list[np.ndarray]:
    """The same with more of a parameter of the model."""
    own = twin.parameter(parameter).read(twin.base_model)
    changed = twin.changed(twin.terms.with_parameters({parameter: own + more}))
    found = Posterior(changed, train, (), ["elbow"], FLOOR).predict(np.zeros((1, 0)))
    return [one[0, :, 0] for one in found]


@pytest.mark.parametrize(
    "feature",
    [
        Feature("torque", "velocity", SPEEDS, "N m", 4.0, factor="direction"),
        Feature("torque", "load", (0.0, 1.0, 4.0), "N m", 4.0, factor="direction"),
        Feature("torque", "position", (-1.0, 1.0), "N m", 4.0, factor="direction"),
    ],
    ids=lambda feature: feature.over,
)
def test_a_level_of_friction_holds_as_the_models_own_does(
    feature: Feature, twin: TwinModel, recorded: Recorded
) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    (law,) = moved(twin, train, feature, [0.2] * len(feature.knots))
    (own,) = with_own(twin, train, "elbow.frictionloss", 0.2)
    (neither,) = with_own(twin, train, "elbow.frictionloss", 0.0)
    assert np.abs(own - neither).max() > 0.01
    assert np.abs(law - own).max() < 1e-6


PULL = Feature("torque", "position", (-1.0, 1.0), "N m", 4.0), [0.3, -0.2]
MISREAD = Feature("reading", "position", (-1.0, 1.0), "rad", 0.5), [-0.04, 0.06]
RUB = Feature("torque", "position", (-1.0, 1.0), "N m", 4.0, factor="direction"), [0.1, 0.3]
WEAR = Feature("torque", "load", (0.0, 1.0), "N m", 4.0, factor="direction"), [0.05, 0.2]
SLACK = Feature("torque", "velocity", (0.02, 0.2), "N m", 4.0, memory="play"), [0.1, 0.2]
SERVO = Feature("command", "time", (0.0, 8.0), "1", 3.0, factor="error"), [0.0, -0.5]


@pytest.mark.parametrize(
    ("one", "other"),
    [(PULL, MISREAD), (RUB, WEAR), (SLACK, SERVO), (MISREAD, RUB)],
    ids=["torque and reading", "two frictions", "memory and servo", "reading and friction"],
)
def test_laws_act_together_whichever_of_them_is_given(
    one: Any, other: Any, twin: TwinModel, recorded: Recorded
) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    (none,) = moved(twin, train, None, [])
    (alone,) = moved(twin, train, *one)
    (both,) = moved(twin, train, *one, given=(GivenLaw(other[0], np.array(other[1])),))
    (swapped,) = moved(twin, train, *other, given=(GivenLaw(one[0], np.array(one[1])),))
    (given,) = moved(twin, train, None, [], tuple(GivenLaw(law, np.array(values)) for law, values in (one, other)))
    assert np.abs(alone - none).max() > 5e-3
    assert np.abs(both - alone).max() > 5e-3
    assert np.abs(swapped - both).max() < 1e-9
    assert np.abs(given - both).max() < 1e-9


def test_two_levels_of_friction_add_up(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    level = Feature("torque", "position", (-1.0, 1.0), "N m", 4.0, factor="direction")
    (both,) = moved(twin, train, level, [0.15, 0.15], (GivenLaw(level, np.array([0.05, 0.05])),))
    (own,) = with_own(twin, train, "elbow.frictionloss", 0.2)
    assert np.abs(both - own).max() < 1e-6


def test_friction_one_way_is_half_of_it_and_a_constant_torque(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    one_way = Feature("torque", "velocity", SPEEDS, "N m", 4.0, factor="direction")
    (found,) = moved(twin, train, one_way, [0.0, 0.0, 0.2, 0.2])
    (either_way,) = with_own(twin, train, "elbow.frictionloss", 0.2)
    (neither,) = with_own(twin, train, "elbow.frictionloss", 0.0)
    falling = np.gradient(either_way) < -1e-3
    rising = np.gradient(either_way) > 1e-3
    # forwards as with the friction, backwards as without it
    assert np.abs(found - either_way)[rising].mean() < 0.5 * np.abs(neither - either_way)[rising].mean()
    assert np.abs(found - neither)[falling].mean() < 0.5 * np.abs(neither - either_way)[falling].mean()


def test_a_torque_over_the_acceleration_is_inertia(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    feature = Feature("torque", "acceleration", (-500.0, 0.0, 500.0), "N m", 40.0)
    (law,) = moved(twin, train, feature, [1.0, 0.0, -1.0])  # 2e-3 kg m2
    (own,) = with_own(twin, train, "elbow.armature", 2e-3)
    (neither,) = with_own(twin, train, "elbow.armature", 0.0)
    # but for the low-pass on the acceleration
    assert np.abs(law - own).mean() < 0.5 * np.abs(neither - own).mean()


def test_a_torque_over_time_and_velocity_is_damping_where_it_is_constant(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    feature = Feature("torque", "time", (0.0, 10.0), "N m s/rad", 4.0, factor="velocity")
    (law,) = moved(twin, train, feature, [-0.2, -0.2])
    (own,) = with_own(twin, train, "elbow.damping", 0.2)
    (neither,) = with_own(twin, train, "elbow.damping", 0.0)
    assert np.abs(law - own).mean() < 0.02 * np.abs(neither - own).mean()


def test_a_command_of_limited_rate_arrives_as_the_librarys_does(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    feature = Feature("command", "command_rate", (1.0, 2.0), "1", 2.0, memory="slew")
    (law,) = moved(twin, train, feature, [1.0, 0.0])
    (neither,) = moved(twin, train, feature, [0.0, 0.0])
    limited = twin.changed(
        twin.terms.with_effect(EffectTerm(effect="rate_limit", target="elbow", values={"rate": 1.0}))
    )
    own = Posterior(limited, train, (), ["elbow"], FLOOR).predict(np.zeros((1, 0)))[0][0, :, 0]
    assert np.abs(law - own).mean() < 0.02 * np.abs(neither - own).mean()


def test_a_straight_line_is_smooth_on_knots_that_are_dense_about_none(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    at = np.array([-2.0, -0.5, -0.1, 0.0, 0.1, 0.5, 2.0])
    tracks = [track(twin, twin, one, "elbow", twin.actuators.index("elbow"), []) for one in train]
    feature = Feature("torque", "velocity", tuple(at), "N m", 1.0)
    problem = LawProblem(
        twin, train, (), ["elbow"], FLOOR, feature=feature, joint="elbow", actuator=1, tracks=tracks, smoothness=100.0
    )
    line, bent = (problem.point(np.zeros(0), curve)[None] for curve in (0.1 * at, 0.1 * np.abs(at)))
    bends = slice(len(at), None)  # behind the values' own sizes
    assert np.abs(problem.prior_residuals(line)[:, bends]).max() < 1e-9
    assert np.abs(problem.prior_residuals(bent)[:, bends]).max() > 1.0


def test_gravity_turns_about_a_link_with_all_joints_before_it(twin: TwinModel, recorded: Recorded) -> None:
    train, _ = recorded("sound", 8.0, 6.0)
    angles = train[0].states
    both = angles.sum(axis=1)  # shoulder and elbow have parallel axes
    found = orientation(twin, angles, "elbow")
    assert min(np.std(found - both), np.std(found + both)) < 1e-9 < 0.1 < np.std(found)
    assert not orientation(twin, angles, "shoulder").any()  # its own angle says it all


def test_gravity_says_nothing_of_a_link_that_turns_about_the_vertical(arm: Path, tmp_path: Path) -> None:
    upright = tmp_path / "upright.xml"
    upright.write_text(arm.read_text(encoding="utf-8").replace('axis="0 1 0"', 'axis="0 0 1"'), encoding="utf-8")
    twin = TwinModel.load(load_hand(model=upright))
    angles = np.random.default_rng(1).uniform(-1.0, 1.0, (50, 2))
    assert not orientation(twin, angles, "elbow").any()


def test_every_effect_of_the_library_has_an_answer_that_a_search_can_give() -> None:
    assert set(ANSWERS) == set(BUILT_IN) - {"coupling"}
    motion = np.linspace(-1.0, 1.0, 500)
    seen = dict.fromkeys(Track.VARIABLES, motion) | {"heat": motion + 1.0, "time": 20.0 * motion + 20.0}
    known = features(8.0, seen, {("shoulder", over): motion for over in OF_NEIGHBOURS})
    said = {(one.port, variable) for one in known for variable in one.variables}
    for answers in ANSWERS.values():
        assert set(answers) <= said
