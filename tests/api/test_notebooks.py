"""The notebooks run from top to bottom, in an empty folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

NOTEBOOKS = Path(__file__).resolve().parents[2] / "docs" / "notebooks"


def ran(name: str) -> dict[str, Any]:
    """What a notebook's cells leave behind."""
    path = NOTEBOOKS / f"{name}.py"
    names: dict[str, Any] = {}
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), names)
    return names


@pytest.mark.slow
def test_the_tutorial_finds_what_is_hidden(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    cells = ran("tutorial")
    assert [one.name for one in cells["found"].findings] == ["sensor_gain:rh_FFJ3"]
    assert cells["found"].findings[0].parameters["factor"].value == pytest.approx(1.1, rel=0.01)
    assert cells["after"].mse_rad2 < 0.1 * cells["before"].mse_rad2


@pytest.mark.slow
def test_the_real_recording_is_judged(shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not (shared_data / "so101_real" / "so101.xml").is_file():
        pytest.skip("so101_real is not on this machine")
    monkeypatch.setenv("SO101", str(shared_data / "so101_real"))
    monkeypatch.chdir(tmp_path)
    cells = ran("real_recording")
    assert 0.0 < cells["compared"].noise_floor_rad2 < cells["compared"].mse_rad2
    assert cells["checked"].table().row_count == len(cells["checked"].parameters)
