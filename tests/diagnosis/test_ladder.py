"""The ladder: the error falls by named steps, and what is stored is the twin of the last one."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnosis.conftest import JOINT, called
from twin_daemon.figures.ladder import ladder_figure
from twin_daemon.versions import VersionStore


@pytest.mark.slow
def test_the_error_falls_until_nothing_is_left(misread: tuple[Path, Path], tmp_path: Path, state_dir: Path) -> None:
    fitted, held = map(str, misread)
    page = tmp_path / "ladder.html"
    result = called(
        "ladder", "--recording", fitted, "--holdout", held, "--max-steps", "2", "--plot", str(page),
        result=tmp_path / "ladder.json",
    )  # fmt: skip
    start, first = result["steps"][:2]
    assert start["effect"] is None
    assert (first["effect"], first["joints"]) == ("sensor_gain", [JOINT])
    assert first["mse_rad2"] < 0.1 * start["mse_rad2"]
    assert first["holdout_mse_rad2"] < 0.1 * start["holdout_mse_rad2"]
    assert all(step["verdict"] for step in result["steps"])
    assert result["references"]["raw_command"]["holdout_mse_rad2"] > first["holdout_mse_rad2"]
    assert result["references"]["parameters_alone"]["holdout_mse_rad2"] > first["holdout_mse_rad2"]
    assert 0 < result["noise_floor_rad2"] < first["mse_rad2"]

    again = called("compare", "--recording", held, "--version", result["version"], result=tmp_path / "c.json")
    assert again["mse_rad2"] == pytest.approx(result["steps"][-1]["holdout_mse_rad2"])
    record = VersionStore("shadow_hand").get(result["version"])
    assert record.kind == "effect_added"
    assert record.errors["holdout_after"]["mse_rad2"] == result["steps"][-1]["holdout_mse_rad2"]
    html = page.read_text(encoding="utf-8")
    assert "sensor_gain" in html
    assert '<script src="http' not in html


def test_where_time_is_over_values_are_fitted_and_stored(
    misread: tuple[Path, Path], tmp_path: Path, state_dir: Path
) -> None:
    fitted, held = map(str, misread)
    result = called(
        "ladder", "--recording", fitted, "--holdout", held, "--within", "1", result=tmp_path / "ladder.json"
    )  # fmt: skip
    start, together = result["steps"]
    assert (start["effect"], together["effect"], together["together"]) == (None, None, True)
    assert together["holdout_mse_rad2"] < start["holdout_mse_rad2"]
    assert result["verdict"] == "unexplained"
    assert any("--within" in note for note in result["notes"])
    assert VersionStore("shadow_hand").get(result["version"]).kind == "calibrated"


def test_nothing_is_added_to_a_sound_hand(sound: Path, tmp_path: Path, state_dir: Path) -> None:
    result = called("ladder", "--recording", str(sound), result=tmp_path / "ladder.json")
    assert [step["effect"] for step in result["steps"]] == [None]
    assert result["verdict"] == "within_noise"
    assert result["version"] is None
    assert not [p for p in state_dir.rglob("*") if p.is_file()]


def test_a_hand_at_rest_has_no_ladder(still: Path, tmp_path: Path) -> None:
    result = called("ladder", "--recording", str(still), result=tmp_path / "ladder.json")
    assert result["verdict"] == "not_excited"
    assert result["steps"][0]["mse_rad2"] is None


def test_the_plot_names_its_lines() -> None:
    steps = [
        {"effect": None, "target": None, "parameters": {}, "mse_rad2": 1e-3, "holdout_mse_rad2": 2e-3},
        {"effect": "spring", "target": "rh_FFJ1", "parameters": {"stiffness": 0.1}, "mse_rad2": 1e-5,
         "holdout_mse_rad2": 2e-5},
    ]  # fmt: skip
    references = {
        "raw_command": {"mse_rad2": 1e-2, "holdout_mse_rad2": 1e-2},
        "last_promoted": {"mse_rad2": None, "holdout_mse_rad2": None},
    }
    figure = ladder_figure("the error", steps, references, 1e-8)
    assert [trace.name for trace in figure.data] == [
        "fitted motion", "held-out motion", "raw command", "noise floor of the sensors",
    ]  # fmt: skip
    assert figure.layout.yaxis.type == "log"
