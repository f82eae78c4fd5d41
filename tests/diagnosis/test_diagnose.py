"""`twin diagnose` on hands that it has not seen, held to its contract."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from tests.diagnosis.conftest import FACTOR, JOINT, called
from twin_daemon.cli.app import main
from twin_daemon.effects import LIBRARY
from twin_daemon.hand import Hand
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.versions import VersionStore


@pytest.fixture(scope="session")
def named(misread: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The diagnosis of the joint that is misread."""
    fitted, held = map(str, misread)
    result = tmp_path_factory.mktemp("named") / "named.json"
    return called("diagnose", "--recording", fitted, "--holdout", held, result=result)


def test_the_hidden_effect_is_named_and_its_value_found(named: dict[str, Any]) -> None:
    assert named["verdict"] == "explained"
    first = named["findings"][0]
    assert (first["effect"], first["joints"]) == ("sensor_gain", [JOINT])
    factor = first["parameters"]["factor"]
    assert factor["unit"] == "1"
    assert factor["ci95"][0] < FACTOR < factor["ci95"][1]
    assert factor["value"] == pytest.approx(FACTOR, rel=0.01)


def test_a_finding_brings_its_evidence(named: dict[str, Any]) -> None:
    first = named["findings"][0]
    assert first["evidence"] > 100
    assert first["holdout_mse_after"] < first["holdout_mse_before"]
    low, high = first["holdout_gain_ci95"]
    assert 0 < low <= first["holdout_gain"] <= high < 1
    assert first["confusable_with"] == []
    assert LIBRARY["sensor_gain"].story.cause in first["explanation"]


def test_every_candidate_that_lost_says_why(named: dict[str, Any]) -> None:
    assert len(named["tried"]) > 10
    assert {trial["effect"] for trial in named["tried"]} <= set(LIBRARY)
    assert all(trial["lost_because"] for trial in named["tried"])


def test_it_says_where_the_model_fails(named: dict[str, Any]) -> None:
    assert named["where"][0]["joint"] == JOINT
    assert {"condition", "rmse_rad", "bias_rad", "seconds"} <= named["where"][0].keys()
    assert {
        "next_experiment",
        "parts",
        "moved_parameters",
        "hand",
        "version",
        "seed",
        "notes",
        "wall_s",
    } <= named.keys()


def test_an_effect_that_is_fitted_anew_comes_to_the_same_values(named: dict[str, Any], tmp_path: Path) -> None:
    """The same recordings and the same fit: not two intervals of one parameter that exclude each other."""
    first = named["findings"][0]
    recordings = ["--recording", named["fitted_on"][0]["path"], "--holdout", named["held_out_on"][0]["path"]]
    fitted = called("add", first["effect"], "--joint", first["target"], *recordings, result=tmp_path / "anew.json")
    for name, said in first["parameters"].items():
        anew = fitted["parameters"][f"{first['effect']}:{first['target']}.{name}"]
        low, high = said["ci95"]
        assert low <= anew["value"] <= high
        assert anew["ci95"][0] <= said["value"] <= anew["ci95"][1]


def test_a_finding_is_taken_over_with_its_figures(
    named: dict[str, Any], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One value, one interval and one figure by one name, in the diagnosis and in what is added of it."""
    written, first = tmp_path / "named.json", named["findings"][0]
    written.write_text(json.dumps(named))
    added = called("add", "--finding", f"{written}:1", result=tmp_path / "a.json")
    assert (added["effect"], added["targets"]) == (first["effect"], [first["target"]])
    assert added["finding"] == first
    assert added["holdout_before"]["mse_rad2"] == first["free_holdout_mse_before"]
    assert added["holdout_after"]["mse_rad2"] == first["free_holdout_mse_after"]
    assert added["holdout_joints_before"]["mse_rad2"] == first["free_holdout_joints_mse_before"]
    assert added["holdout_joints_after"]["mse_rad2"] == first["free_holdout_joints_mse_after"]
    assert first["free_holdout_mse_after"] < 0.1 * first["free_holdout_mse_before"]
    assert added["terms"]["effects"][0]["values"] == first["values"]
    assert added["terms"]["parameters"] == first["moved"]
    value, taken = first["parameters"]["factor"], added["parameters"][f"sensor_gain:{JOINT}.factor"]
    assert (taken["value"], taken["ci95"]) == (value["value"], value["ci95"])
    stored = VersionStore("shadow_hand").get(added["version"])
    assert stored.errors["holdout_after"]["mse_rad2"] == first["free_holdout_mse_after"]
    said = capsys.readouterr().out
    assert "in short pieces of its part" in said
    assert "one free roll-out of the whole hand" in said

    for argv, code, why in (
        (["backlash", "--finding", str(written)], 3, f"the finding is sensor_gain at {JOINT}"),
        (["--finding", f"{written}:2"], 3, "has no finding 2"),
        (["--finding", str(written), "--version", added["version"]], 3, "diagnosis of another twin"),
        (["--finding", str(written), "--recording", named["held_out_on"][0]["path"]], 3, "not the recordings"),
        (["--finding", str(written), "--set", "factor=1.2"], 2, "exclude each other"),
        (["backlash"], 2, "nothing to add"),
    ):
        assert main(["add", *argv]) == code, argv
        assert why in capsys.readouterr().err


def test_a_sound_hand_is_within_noise(sound: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = called("diagnose", "--recording", str(sound), "--joints", "FFJ3", result=tmp_path / "sound.json")
    assert result["verdict"] == "within_noise"
    assert result["findings"] == []
    assert any("held out" in note for note in result["notes"])
    assert "Within noise" in capsys.readouterr().out


def test_a_hand_at_rest_is_not_excited_and_gets_a_motion(
    still: Path, hand: Hand, tmp_path: Path, state_dir: Path
) -> None:
    result = called("diagnose", "--recording", str(still), "--joints", "rh_FFJ3", result=tmp_path / "still.json")
    assert result["verdict"] == "not_excited"
    assert "record" in result["reason"]
    proposed = result["next_experiment"]
    assert Path(proposed["path"]).parent == state_dir / "experiments"
    assert load_trajectory(proposed["trajectory"], hand).joints == (JOINT,)
    assert [p for p in state_dir.rglob("*") if p.is_file()] == [Path(proposed["path"])]


@pytest.mark.parametrize(
    ("argv", "says"),
    [
        (["diagnose", "--recording", "BAG", "--joints", "rh_FFJ9"], "Did you mean"),
        (["diagnose", "--recording", "nowhere.mcap"], "nowhere.mcap"),
        (["diagnose", "--recording", "BAG", "--holdout", "nowhere.mcap"], "nowhere.mcap"),
        (["ladder", "--recording", "BAG", "--plot", "/nowhere/at/all.html"], "folder does not exist"),
        (["add", "stribek", "--joint", JOINT], "Did you mean 'stribeck_friction'?"),
        (["add", "backlash", "--joint", "rh_FFJ33"], "Did you mean 'rh_FFJ3'?"),
        (["add", "spring", "--joint", "rh_FFJ0"], "rh_FFJ1 or rh_FFJ2"),
        (["add", "backlash", "--joint", "rh_FFJ1"], "Give --joint rh_FFJ0"),
        (["add", "gravity_tilt", "--joint", JOINT], "Give --joint hand"),
        (["add", "backlash", "--joint", JOINT, "--set", "gap=-1"], "outside physics"),
        (["add", "backlash", "--joint", JOINT, "--set", "play=0.1"], "no parameter 'play'"),
        (["add", "backlash", "--joint", JOINT, "--holdout", "BAG"], "--recording"),
        (["add", "backlash", "--joint", "rh_MFJ3", "--recording", "BAG"], "does not move"),
        (["remove", "backlash", "--joint", JOINT], "has no 'backlash'"),
    ],
)
def test_what_cannot_be_used_is_refused_and_nothing_is_stored(
    argv: list[str], says: str, sound: Path, state_dir: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(sound) if word == "BAG" else word for word in argv]) == 3
    captured = capsys.readouterr()
    assert captured.out == ""
    assert says in captured.err
    assert captured.err.count("\n") == 1
    assert not [p for p in state_dir.rglob("*") if p.is_file()]
