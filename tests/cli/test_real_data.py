"""The measured recordings and models that others made, through the commands as a user calls them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.cli.test_offline import call
from twin_daemon.cli.app import main

DISSERTATION_RAD2 = 0.006277


@pytest.fixture(scope="session")
def hand_closing(shared_data: Path) -> list[str]:
    """What names the real closing of the hand, with the motion that caused it."""
    folder = shared_data / "shadow_hand_real"
    if not (folder / "hand_closing.csv").is_file():
        pytest.skip("shadow_hand_real/hand_closing.csv is not on this machine")
    return [
        "--recording",
        str(folder / "hand_closing.csv"),
        "--trajectory",
        f"{folder / 'trajectories.yaml'}:hand_closing",
    ]


@pytest.fixture(scope="session")
def arm(shared_data: Path) -> list[str]:
    folder = shared_data / "so101_real"
    if not (folder / "so101.xml").is_file():
        pytest.skip("so101_real is not on this machine")
    return ["--model", str(folder / "so101.xml"), "--joint-map", str(folder / "joint_map.yaml")]


@pytest.fixture(scope="session")
def menagerie(shared_data: Path) -> list[str]:
    model = shared_data / "third_party_hands" / "shadow_hand" / "right_hand.xml"
    if not model.is_file():
        pytest.skip("third_party_hands/shadow_hand is not on this machine")
    return ["--model", str(model)]


def test_the_second_approach_beats_the_dissertation_on_the_whole_recording(
    hand_closing: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    fitted = call(capsys, "calibrate", *hand_closing, "--space", "second-approach", "--search", "least-squares",
                  "--budget", "60")  # fmt: skip
    assert fitted["after"]["mse_rad2"] < DISSERTATION_RAD2
    assert fitted["evaluations"] <= 60
    assert fitted["parameters"]["FJ2.springref"]["unit"] == "rad"
    whole = call(capsys, "compare", *hand_closing, "--version", fitted["version"])
    assert whole["mse_rad2"] < DISSERTATION_RAD2


def test_compare_of_the_real_closing(hand_closing: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    result = call(capsys, "compare", *hand_closing)
    assert sum(j["moves"] for j in result["joints"].values()) == 12
    assert result["recordings"][0]["onset_estimated"] is True
    assert result["rate_hz"] == pytest.approx(125, rel=0.01)
    # the ramp of the base joints is known to a milliradian; how a pair's sum splits is not
    assert result["joints"]["rh_FFJ3"]["mse_rad2"] < 1e-3
    assert 0 < result["noise_floor_rad2"] < 1e-6


@pytest.mark.slow
def test_the_thumb_is_judged_beside_the_raw_command(shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = shared_data / "shadow_hand_real"
    bag = folder / "thumb_calibration.bag"
    if not bag.is_file():
        pytest.skip("shadow_hand_real/thumb_calibration.bag is not on this machine")
    data = ["--recording", str(bag), "--trajectory", f"{folder / 'trajectories.yaml'}:thumb_calibration"]
    before = call(capsys, "compare", *data)
    assert before["references"]["raw_command"]["mse_rad2"] < 1e-3
    fitted = call(capsys, "calibrate", *data, "--space", "thumb", "--budget", "12")
    assert fitted["after"]["mse_rad2"] <= fitted["before"]["mse_rad2"]
    assert all(p["value"] > 0 for p in fitted["parameters"].values())


def test_another_projects_hand_is_compared_and_checked(
    hand_closing: list[str], menagerie: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = call(capsys, "compare", *hand_closing, *menagerie)
    assert len(result["joints"]) == 24
    assert result["mse_rad2"] is not None
    assert result["joints"]["rh_FFJ3"]["mse_rad2"] < 0.05
    space = tmp_path / "index.yaml"
    entry = {"kind": "damping", "of": ["rh_FFJ3", "rh_FFJ2"]}
    space.write_text(yaml.safe_dump({"schema": 1, "name": "index", "about": "one finger", "parameters": [entry]}))
    checked = call(capsys, "check", *hand_closing, *menagerie, "--space", str(space))
    assert set(checked["parameters"]) == {"rh_FFJ3.damping", "rh_FFJ2.damping"}


def test_a_version_of_another_projects_hand_needs_none_of_its_meshes(
    hand_closing: list[str], menagerie: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import mujoco

    space = tmp_path / "index.yaml"
    entry = {"kind": "kp", "of": ["rh_FFJ3"], "lower": 0.1, "upper": 100.0}
    space.write_text(yaml.safe_dump({"schema": 1, "name": "index", "about": "one joint", "parameters": [entry]}))
    fitted = call(capsys, "calibrate", *hand_closing, *menagerie, "--space", str(space), "--budget", "8")
    assert fitted["after"]["mse_rad2"] <= fitted["before"]["mse_rad2"]
    out = tmp_path / "exported.xml"
    assert main(["versions", "export", fitted["version"], *menagerie, "-o", str(out)]) == 0
    assert mujoco.MjModel.from_xml_path(str(out)).njnt == 24


def test_an_arm_is_compared_and_checked_by_its_own_names(
    arm: list[str], shared_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = ["--recording", str(shared_data / "so101_real" / "multisine")]
    result = call(capsys, "compare", *data, *arm)
    assert result["recordings"][0]["onset_estimated"] is False
    assert result["mse_rad2"] < result["references"]["raw_command"]["mse_rad2"]
    assert len([j for j in result["joints"].values() if j["moves"]]) == 6
    assert np.isfinite(result["noise_floor_rad2"])
    space = tmp_path / "roll.yaml"
    entry = {"kind": "frictionloss", "of": ["wrist_roll", "shoulder_pan"]}
    space.write_text(yaml.safe_dump({"schema": 1, "name": "roll", "about": "two joints", "parameters": [entry]}))
    checked = call(capsys, "check", *data, *arm, "--space", str(space))
    assert checked["parameters"]["wrist_roll.frictionloss"]["verdict"] == "identifiable"
    assert checked["recordings"][0]["commands"] is True
