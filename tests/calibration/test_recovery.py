"""Parameters planted in a simulated hand are found again, with intervals that hold them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.simulation.made import FINGER, recorded
from twin_daemon.calibration.calibrate import Calibration, calibrate
from twin_daemon.calibration.check import advice, prospects
from twin_daemon.calibration.spaces import Space
from twin_daemon.estimation.windows import excerpts
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.terms import Terms
from twin_daemon.simulation.twin import TwinModel

# A third to thrice what the model has, which is what wear and a guessed model differ by.
PLANTED = {
    "rh_FFJ3.damping": 3.0,
    "rh_FFJ0.kp": 0.6,
    "rh_FFJ3.kp": 1.5,
    "rh_FFJ3.frictionloss": 3.0,
    "rh_FFJ2.damping": 2.0,
}
TOLERANCE = 0.06  # of the value: the plant runs at half the twin's step and its sensors are noisy


def space(*entries: dict[str, object]) -> Space:
    parsed = {"schema": 1, "name": "planted", "about": "what was planted", "parameters": list(entries)}
    return Space.model_validate(yaml.safe_load(yaml.safe_dump(parsed)))


SPACE = space(
    {"kind": "kp", "of": ["rh_FFJ0", "rh_FFJ3"], "lower": 0.1, "upper": 100.0},
    {"kind": "damping", "of": ["rh_FFJ2", "rh_FFJ3"], "lower": 0.001, "upper": 5.0},
    {"kind": "frictionloss", "of": ["rh_FFJ3"], "lower": 0.0001, "upper": 1.0},
)


@pytest.fixture(scope="module")
def planted(twin: TwinModel) -> dict[str, float]:
    values = {name: factor * twin.parameter(name).read(twin.model) for name, factor in PLANTED.items()}
    assert all(values.values())
    return values


@pytest.fixture(scope="module")
def found(twin: TwinModel, planted: dict[str, float]) -> Calibration:
    rng = np.random.default_rng(3)
    plant = twin.changed(Terms(parameters=planted)).at_step(0.001)
    train = align(twin, recorded(plant, FINGER, rng))
    reversed_finger = {name: (times, values[::-1]) for name, (times, values) in FINGER.items()}
    held = align(twin, recorded(plant, reversed_finger, rng))
    return calibrate(twin, [train], [held], SPACE, "least-squares", budget=400)


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_parameter_is_recovered(name: str, found: Calibration, planted: dict[str, float]) -> None:
    parameter = found.parameters[name]
    assert parameter.value == pytest.approx(planted[name], rel=TOLERANCE)
    reach = 0.5 * (parameter.ci95[1] - parameter.ci95[0])
    middle = 0.5 * (parameter.ci95[1] + parameter.ci95[0])
    # the step of the plant is another one: twice the interval of the noise alone holds the truth
    assert abs(planted[name] - middle) < 2.0 * reach
    assert not parameter.at_bound
    assert parameter.identifiable == "identifiable"


def test_the_error_falls_to_the_noise_also_where_it_was_not_fitted(found: Calibration) -> None:
    assert found.after_rad2 < 0.02 * found.before_rad2
    assert found.holdout_before_rad2 is not None
    assert found.holdout_after_rad2 is not None
    assert found.holdout_after_rad2 < 0.05 * found.holdout_before_rad2
    assert found.after_rad2 < 10 * (3e-4) ** 2
    assert found.terms.parameters.keys() == PLANTED.keys()


def test_the_history_is_one_falling_curve_of_every_evaluation(found: Calibration) -> None:
    assert found.evaluations == len(found.history) <= 400
    assert (np.diff(found.history) <= 0).all()
    assert found.history[-1] == pytest.approx(found.after_rad2, rel=0.1)


def test_an_onset_that_is_not_known_is_found_beside_the_parameters(twin: TwinModel, planted: dict[str, float]) -> None:
    from tests.simulation.test_alignment import trajectory

    plant = twin.changed(Terms(parameters=planted)).at_step(0.001)
    recording = recorded(plant, FINGER, np.random.default_rng(4), late_s=0.2, seconds=6.0, commands=False)
    result = calibrate(twin, [align(twin, recording, trajectory())], [], SPACE, "least-squares", budget=400)
    assert result.onsets_s[0] == pytest.approx(0.204, abs=0.02)
    # an onset and a servo's lag explain each other, so only what they do together is held to the truth
    assert result.after_rad2 < 0.05 * result.before_rad2


def test_what_the_motion_cannot_tell_is_said_before_and_after(twin: TwinModel, rng: np.random.Generator) -> None:
    aligned = align(twin, recorded(twin, FINGER, rng))
    blind = space(
        {"kind": "kp", "of": ["rh_FFJ0"], "lower": 0.1, "upper": 100.0},
        {"kind": "armature", "of": ["rh_FFJ3"], "lower": 1e-6, "upper": 2e-6},
        {"kind": "range_upper", "of": ["rh_FFJ3"], "reach": 0.05},
    )
    prospect = prospects(twin, [aligned], blind)
    assert prospect["rh_FFJ0.kp"].identifiable == "identifiable"
    assert prospect["rh_FFJ3.range_upper"].identifiable == "not_identifiable"
    told = advice("rh_FFJ3.range_upper", prospect["rh_FFJ3.range_upper"])
    assert told == "drive gently into the upper end stop"
    fitted = calibrate(twin, [aligned], [], blind, "least-squares", budget=60)
    assert fitted.parameters["rh_FFJ3.armature"].identifiable == "not_identifiable"
    assert fitted.parameters["rh_FFJ3.range_upper"].identifiable == "not_identifiable"


def test_a_long_recording_is_searched_in_stretches_that_start_where_it_is(
    twin: TwinModel, rng: np.random.Generator
) -> None:
    long = {name: ([*times, 60.0], [*values, values[-1]]) for name, (times, values) in FINGER.items()}
    aligned = align(twin, recorded(twin, long, rng, seconds=60.0))
    parts = excerpts([aligned])
    assert len(parts) == 5
    assert sum(part.time_s[-1] for part in parts) <= 40.0 + 1e-6
    for part in parts:
        assert part.time_s[0] == 0.0
        np.testing.assert_allclose(part.start_position, part.measured[0])
        commanded = [twin.actuators.index(name) for name in FINGER]
        then, now = aligned.controls(twin, np.array([-part.onset_s])), part.controls(twin, np.zeros(1))
        np.testing.assert_allclose(now[0, commanded], then[0, commanded], atol=1e-12)
    short = align(twin, recorded(twin, FINGER, rng))
    assert excerpts([short]) == [short]


def test_a_file_of_terms_is_the_fit_again(twin: TwinModel, found: Calibration, tmp_path: Path) -> None:
    from twin_daemon.simulation.terms import load_terms

    path = tmp_path / "terms.yaml"
    path.write_text(yaml.safe_dump(found.terms.as_json()))
    again = twin.changed(load_terms(path))
    assert again.parameter("rh_FFJ3.damping").read(again.model) == found.parameters["rh_FFJ3.damping"].value
