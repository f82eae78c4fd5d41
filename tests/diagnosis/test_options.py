"""What a diagnosis may take for granted, and how long it may take."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.diagnosis.conftest import JOINT, called
from twin_daemon.cli.app import main


def test_an_error_that_is_tolerated_is_no_finding(misread: tuple[Path, Path], tmp_path: Path) -> None:
    fitted, held = map(str, misread)
    said = called(
        "diagnose", "--recording", fitted, "--holdout", held, "--tolerance-mrad", "300", result=tmp_path / "said.json"
    )
    assert (said["verdict"], said["findings"]) == ("within_noise", [])


def test_time_that_is_over_is_said_with_what_is_known(misread: tuple[Path, Path], tmp_path: Path) -> None:
    fitted, held = map(str, misread)
    said = called("diagnose", "--recording", fitted, "--holdout", held, "--within", "1", result=tmp_path / "said.json")
    assert said["verdict"] == "unexplained"
    assert said["interrupted"] is True
    assert "not searched to the end" in said["reason"]
    assert JOINT in said["reason"]
    assert said["probabilities"] == []  # nobody knows how probable a law is that has not been asked for


@pytest.mark.slow
def test_what_an_exact_model_cannot_be_off_is_an_effect(sound: Path, tmp_path: Path) -> None:
    """The plant's friction and gain are up to 20 % off: noise beside a data sheet, beside an exact model not."""
    arguments = ["diagnose", "--recording", str(sound), "--joints", JOINT]
    assert called(*arguments, result=tmp_path / "sheet.json")["verdict"] == "within_noise"
    exact = called(*arguments, "--nominal-uncertainty", "0", "--within", "20", result=tmp_path / "exact.json")
    assert exact["verdict"] != "within_noise"


@pytest.mark.parametrize("given", ["much", "2", "stiffness=0.1", "gain="])
def test_a_share_that_is_none_is_one_line(given: str, sound: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["diagnose", "--recording", str(sound), "--nominal-uncertainty", given]) == 3
    assert "0 to 1" in capsys.readouterr().err
