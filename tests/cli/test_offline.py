"""`twin compare`, `check` and `calibrate` as a program calls them, held to their contract."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.simulation.made import worn_finger
from twin_daemon.cli.app import main
from twin_daemon.simulation.twin import TwinModel
from twin_daemon.versions import VersionStore

SPACE = """
schema: 1
name: base
about: the base joint of one finger
parameters:
  - {kind: damping, of: [rh_FFJ3], lower: 0.001, upper: 5.0}
  - {kind: kp, of: [rh_FFJ3], lower: 0.1, upper: 100.0}
"""


@pytest.fixture(scope="session")
def bag(twin: TwinModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return worn_finger(twin, tmp_path_factory.mktemp("bags") / "finger.mcap")


@pytest.fixture
def space(tmp_path: Path) -> str:
    path = tmp_path / "base.yaml"
    path.write_text(SPACE)
    return str(path)


def call(capsys: pytest.CaptureFixture[str], *argv: str) -> dict[str, Any]:
    """The JSON on standard output of a command that must succeed; strict: no NaN, nothing beside it."""
    code = main([*argv, "--json", "-"])
    captured = capsys.readouterr()
    assert code == 0, captured.err

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} in the JSON")

    result = json.loads(captured.out, parse_constant=refuse)
    assert result["schema"] == 1
    return result


def test_compare_reports_what_the_contract_says(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = call(capsys, "compare", "--recording", str(bag))
    assert {"mse_rad2", "joints", "groups", "references", "rate_hz", "samples", "dropped", "onset_s",
            "noise_floor_rad2", "version"} <= result.keys()  # fmt: skip
    assert len(result["joints"]) == 24
    for joint in result["joints"].values():
        assert {"mse_rad2", "rmse_rad", "max_abs_rad", "bias_rad", "lag_s"} <= joint.keys()
    moving = [j["mse_rad2"] for j in result["joints"].values() if j["moves"]]
    assert len(moving) == 3
    assert result["mse_rad2"] == pytest.approx(np.mean(moving))
    assert result["groups"]["FJ3"]["mse_rad2"] == pytest.approx(result["joints"]["rh_FFJ3"]["mse_rad2"])
    assert result["references"]["raw_command"]["mse_rad2"] > 0
    assert result["references"]["last_promoted"]["mse_rad2"] is None
    assert result["joints"]["rh_THJ5"]["lag_s"] is None
    assert result["rate_hz"] == pytest.approx(125, rel=1e-3)
    assert result["samples"] == 689
    assert 0 < result["noise_floor_rad2"] < result["mse_rad2"]


def test_check_says_what_each_parameter_would_get(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    result = call(capsys, "check", "--recording", str(bag))
    (one,) = result["recordings"]
    assert one["commands"] is True
    assert set(one["moving_joints"]) == {"rh_FFJ1", "rh_FFJ2", "rh_FFJ3"}
    assert len(one["still_joints"]) == 21
    assert one["saturated_commands"] == []
    assert {p["verdict"] for p in result["parameters"].values()} <= {"identifiable", "weak", "not_identifiable"}
    assert result["parameters"]["rh_FFJ3.kp"]["identifiable"] is True
    for parameter in result["parameters"].values():
        assert parameter["identifiable"] or parameter["advice"]


def test_calibrate_fits_stores_and_the_version_is_the_better_twin(
    bag: Path, space: str, twin: TwinModel, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted = call(capsys, "calibrate", "--recording", str(bag), "--space", space, "--search", "least-squares")
    assert {"before", "after", "holdout_before", "holdout_after", "evaluations", "wall_s", "parameters", "history",
            "version"} <= fitted.keys()  # fmt: skip
    assert fitted["after"]["mse_rad2"] < 0.1 * fitted["before"]["mse_rad2"]
    assert fitted["holdout_after"]["mse_rad2"] < 0.1 * fitted["holdout_before"]["mse_rad2"]
    assert len(fitted["history"]) == fitted["evaluations"] > 0
    assert all(math.isfinite(v) for v in fitted["history"])
    damping = fitted["parameters"]["rh_FFJ3.damping"]
    assert {"value", "unit", "lower", "upper", "at_bound", "ci95", "identifiable"} <= damping.keys()
    truth = 4.0 * twin.parameter("rh_FFJ3.damping").read(twin.model)
    assert damping["value"] == pytest.approx(truth, rel=0.05)
    assert damping["ci95"][0] <= truth <= damping["ci95"][1]
    assert damping["unit"] == "N m s/rad"
    assert any("held out" in note for note in fitted["notes"])

    record = VersionStore("shadow_hand").get(fitted["version"])
    assert record.parameters["rh_FFJ3.damping"].value == damping["value"]
    assert VersionStore("shadow_hand").last_promoted() is None
    better = call(capsys, "compare", "--recording", str(bag), "--version", fitted["version"])
    assert better["version"] == fitted["version"]
    nominal = call(capsys, "compare", "--recording", str(bag), "--version", "nominal")
    assert better["mse_rad2"] < 0.1 * nominal["mse_rad2"]

    assert main(["versions", "promote", fitted["version"]]) == 0
    capsys.readouterr()
    promoted = call(capsys, "compare", "--recording", str(bag), "--version", "nominal")
    assert promoted["references"]["last_promoted"]["mse_rad2"] == pytest.approx(better["mse_rad2"])
    assert call(capsys, "compare", "--recording", str(bag))["mse_rad2"] == pytest.approx(better["mse_rad2"])


def test_an_exported_version_is_the_fitted_twin_without_this_program(
    bag: Path, space: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import mujoco

    fitted = call(capsys, "calibrate", "--recording", str(bag), "--space", space, "--budget", "30")
    path = tmp_path / "hand.xml"
    assert main(["versions", "export", fitted["version"], "-o", str(path)]) == 0
    model = mujoco.MjModel.from_xml_path(str(path))
    damping = model.joint("rh_FFJ3").damping[0]
    assert damping == pytest.approx(fitted["parameters"]["rh_FFJ3.damping"]["value"], rel=1e-5)


@pytest.mark.parametrize(
    "argv", [["compare"], ["check"], ["calibrate", "--budget", "5"]], ids=["compare", "check", "calibrate"]
)
def test_people_see_whole_names_at_eighty_columns(
    argv: list[str], bag: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert main([argv[0], "--recording", str(bag), *argv[1:]]) == 0
    shown = capsys.readouterr().out
    assert "…" not in shown
    assert max(len(line) for line in shown.splitlines()) <= 80
    assert "rh_FFJ3" in shown


def test_compare_draws_a_page_that_asks_nobody(bag: Path, tmp_path: Path) -> None:
    page = tmp_path / "finger.html"
    assert main(["compare", "--recording", str(bag), "--plot", str(page)]) == 0
    html = page.read_text(encoding="utf-8")
    assert "rh_FFJ3" in html
    assert "measured against twin" in html
    assert '<script src="http' not in html
