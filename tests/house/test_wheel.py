"""What is installed is whole: files that are no Python are in the wheel as well."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_wheel_holds_what_page_and_service_are_made_of(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    held = set(zipfile.ZipFile(wheel).namelist())
    folders = ("twin_daemon/report/templates", "workbench/templates", "workbench/static")
    needed = {str(path.relative_to(ROOT)) for folder in folders for path in (ROOT / folder).iterdir()}
    needed |= {f"twin_daemon/_data/systemd/{path.name}" for path in (ROOT / "systemd").iterdir()}
    assert len(needed) > 20
    assert needed <= held
