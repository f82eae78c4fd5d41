"""What is installed is whole: files that are no Python are in the wheel as well, and the program needs no checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


USE = """
import sys
import twin_daemon
from twin_daemon.cli.app import main
print(twin_daemon.__file__, file=sys.stderr)
for argv in (
    ["hand", "--trajectory", "hand_closing", "--seconds", "2", "--output", "made.mcap"],
    ["compare", "--recording", "made.mcap", "--version", "real_closing", "--json", "compared.json"],
    ["effects", "backlash"],
    ["service", "install", "--root", "root", "--executable", "/opt/twin", "--dry-run"],
    ["config", "check", "twin.yaml"],
):
    assert main(argv) == 0, argv
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (made,) = folder.glob("*.whl")
    return made


def test_the_wheel_holds_what_page_and_service_are_made_of(wheel: Path) -> None:
    held = set(zipfile.ZipFile(wheel).namelist())
    folders = ("twin_daemon/report/templates", "twin_daemon/web/templates", "twin_daemon/web/static")
    needed = {str(path.relative_to(ROOT)) for folder in folders for path in (ROOT / folder).iterdir()}
    needed |= {f"twin_daemon/_data/systemd/{path.name}" for path in (ROOT / "systemd").iterdir()}
    assert len(needed) > 20
    assert needed <= held


def test_the_wheel_alone_is_enough(wheel: Path, tmp_path: Path) -> None:
    site = tmp_path / "site"
    zipfile.ZipFile(wheel).extractall(site)
    work = tmp_path / "work"
    (work / "root").mkdir(parents=True)
    (work / "twin.yaml").write_bytes((site / "twin_daemon/_data/systemd/twin.yaml").read_bytes())
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run([sys.executable, "-c", USE], cwd=work, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stderr.startswith(str(site))
    assert json.loads((work / "compared.json").read_text())["mse_rad2"] > 0.0
