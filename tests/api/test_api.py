"""The twin from Python says what the commands say, and costs nothing until it is used."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

import twin_daemon as td
from tests.diagnosis.conftest import called
from tests.diagnosis.rig import SERVOS, late_rig
from twin_daemon.errors import BadInput, UsageError

PAGE = Path(__file__).resolve().parents[2] / "docs" / "python.md"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the robot and the recording of the page."""
    made = tmp_path_factory.mktemp("lab")
    model, bag = late_rig(made)
    model.rename(made / "arm.xml")
    bag.rename(made / "run.mcap")
    return made


def test_importing_it_loads_nothing_that_is_slow() -> None:
    code = "import sys, twin_daemon as td; dir(td); print(*sys.modules)"
    loaded = set(
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    )
    assert "twin_daemon" in loaded
    assert not loaded & {"numpy", "mujoco", "scipy", "pydantic", "plotly", "zenoh", "rich", "typer", "yaml"}
    assert len([name for name in loaded if name.startswith("twin_daemon.")]) == 0


def test_functions_bear_the_names_of_packages_that_stay_packages() -> None:
    code = (
        "import twin_daemon.hand, twin_daemon.versions, twin_daemon as td;"
        "from twin_daemon.hand import load_hand; from twin_daemon.versions import VersionStore;"
        "assert td.hand('shadow_hand').description == load_hand(); assert td.versions().hand == 'shadow_hand'"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        td.nothing  # type: ignore[attr-defined]  # noqa: B018


def test_results_have_what_the_commands_write(folder: Path, tmp_path: Path) -> None:
    arm = td.hand(model=folder / "arm.xml")
    run = td.recording(folder / "run.mcap", arm)
    assert run.position_rad.shape == (len(run.time_s), len(SERVOS))
    options = ("--model", str(folder / "arm.xml"))
    recorded = (*options, "--recording", str(folder / "run.mcap"))

    compared = td.compare(run)
    assert compared.as_json() == called("compare", *recorded, result=tmp_path / "c.json")
    assert compared.joints["left"].rmse_rad > 0.0
    assert compared.table().row_count == len(SERVOS)
    assert len(list(compared.figure().data)) > 0

    checked = td.check(run)
    assert checked.as_json() == called("check", *recorded, result=tmp_path / "k.json")
    assert checked.table().row_count == len(checked.parameters)
    assert len(list(checked.figure().data)) == 1

    added = td.add("command_delay", "robot", values={"delay": 0.03}, robot=arm)
    with_delay = td.compare(run, version=added.version)
    assert compared.mse_rad2 is not None
    assert with_delay.mse_rad2 is not None
    assert with_delay.mse_rad2 < 0.01 * compared.mse_rad2
    listed = td.versions(arm)
    assert listed.as_json() == called("versions", "list", *options, result=tmp_path / "v.json")
    assert listed.aliases["candidate"] == added.version
    assert listed.table().row_count == 2


def test_what_cannot_be_used_is_said(folder: Path) -> None:
    arm = td.hand(model=folder / "arm.xml")
    with pytest.raises(BadInput, match="no such recording"):
        td.recording(folder / "nowhere.mcap", arm)
    with pytest.raises(BadInput, match=r"nowhere\.xml"):
        td.hand(model=folder / "nowhere.xml")
    with pytest.raises(UsageError, match="no recording"):
        td.compare([])
    with pytest.raises(UsageError, match="different robots"):
        td.diagnose([td.recording(folder / "run.mcap", arm), td.recording(folder / "run.mcap")])
    with pytest.raises(UsageError, match="nothing to add"):
        td.add(robot=arm)


@pytest.mark.slow
def test_the_page_is_true(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every block of docs/python.md runs, one after another, in a folder with its files."""
    monkeypatch.chdir(folder)
    blocks = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), flags=re.M | re.S)
    assert len(blocks) >= 5
    names: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, str(PAGE), "exec"), names)
    found, added, ladder = names["found"], names["added"], names["ladder"]
    assert found.findings[0].name == "command_delay:robot"  # type: ignore[attr-defined]
    first = found.findings[0]  # type: ignore[attr-defined]
    assert added.holdout_after.mse_rad2 == first.free_holdout_mse_after_rad2  # type: ignore[attr-defined]
    assert ladder.steps[1].target == "robot"  # type: ignore[attr-defined]
