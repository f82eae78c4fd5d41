"""A joint that is told to move and stands still is no joint to leave out: it is the first that someone asks for."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnosis.conftest import called
from tests.diagnosis.rig import SERVOS, changed_rig, motion_of
from twin_daemon.recordings.load import load_recording
from twin_daemon.simulation.alignment import align, moving_joints, unanswering_joints
from twin_daemon.workflows.session import open_session


@pytest.fixture(scope="module")
def dead(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, str]:
    """(the MJCF, two bags) of a rig whose left servo has no torque to speak of."""
    folder = tmp_path_factory.mktemp("dead")
    model, fit, held = changed_rig(folder, "actuator_saturation", {"limit": 1e-4}, target="left")
    return str(model), str(fit), str(held)


def test_it_is_told_from_one_that_nobody_asked_to_move(dead: tuple[str, str, str], tmp_path: Path) -> None:
    twin = open_session(None, Path(dead[0])).twin
    still = align(twin, load_recording(Path(dead[1])))
    assert moving_joints([still]) == SERVOS[1:]
    assert unanswering_joints(twin, [still]) == SERVOS[:1]
    held = {**motion_of(SERVOS[1:]), "left": ([0.0, 6.0], [0.0, 0.0])}
    model, bag, _ = changed_rig(tmp_path, "actuator_saturation", {"limit": 1e-4}, target="left", motion=held)
    quiet = open_session(None, model).twin
    assert unanswering_joints(quiet, [align(quiet, load_recording(bag))]) == ()


def test_it_is_named_and_said_so(dead: tuple[str, str, str], tmp_path: Path) -> None:
    model, fit, held = dead
    said = called(
        "diagnose", "--model", model, "--recording", fit, "--holdout", held, result=tmp_path / "said.json"
    )  # fmt: skip
    assert said["verdict"] in ("explained", "ambiguous", "unexplained")
    assert {joint for finding in said["findings"] for joint in finding["joints"]} <= {"left"}
    assert said["parts"]["left"]["times_floor"] > 100.0
    assert any("left: told to move" in note for note in said["notes"])
    checked = called("check", "--model", model, "--recording", fit, result=tmp_path / "checked.json")
    (recording,) = checked["recordings"]
    assert recording["unanswering_joints"] == ["left"]
    assert any("told to move" in warning for warning in recording["warnings"])


def test_one_that_has_answered_before_has_changed(dead: tuple[str, str, str], tmp_path: Path) -> None:
    model, fit, held = dead
    _, healthy, _ = changed_rig(tmp_path, "sensor_offset", {"offset": 0.0}, target="left")
    said = called(
        "diagnose", "--model", model, "--recording", fit, "--holdout", held, "--baseline", str(healthy),
        result=tmp_path / "said.json",
    )  # fmt: skip
    assert said["verdict"] in ("explained", "ambiguous", "unexplained")
    assert {joint for change in said["changes"] for joint in change["joints"]} == {"left"}
    assert any("left: told to move" in note for note in said["notes"])


def test_what_was_named_there_can_be_added(dead: tuple[str, str, str], tmp_path: Path) -> None:
    model, fit, held = dead
    asked = ("add", "actuator_saturation", "--joint", "left", "--model", model, "--recording", fit, "--holdout", held)
    said = called(*asked, result=tmp_path / "added.json")
    assert said["parameters"]["actuator_saturation:left.limit"]["value"] < 0.01
