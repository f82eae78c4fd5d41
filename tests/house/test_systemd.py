"""The unit is what systemd accepts, and keeps its protections."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from twin_daemon.daemon.configuration import load_config

SYSTEMD = Path(__file__).resolve().parents[2] / "systemd"
UNIT = SYSTEMD / "twin-daemon.service"
MOST_EXPOSED = 15  # of 100, as systemd-analyze counts

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not on this machine")


def analyze(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True)


@needs_systemd
def test_systemd_accepts_the_unit(tmp_path: Path) -> None:
    unit = tmp_path / UNIT.name
    text = UNIT.read_text(encoding="utf-8")
    assert "/opt/twin_daemon/.venv/bin/twin " in text
    unit.write_text(text.replace("/opt/twin_daemon/.venv/bin/twin ", f"{sys.executable} "), encoding="utf-8")
    done = analyze("verify", "--man=no", "--recursive-errors=no", str(unit))
    complaints = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert not complaints
    assert done.returncode == 0


@needs_systemd
def test_the_unit_keeps_its_protections() -> None:
    done = analyze("security", "--offline=true", f"--threshold={MOST_EXPOSED}", "--no-pager", str(UNIT))
    assert done.returncode == 0, done.stdout.splitlines()[-1]


def test_the_configuration_that_comes_with_it_is_valid() -> None:
    assert load_config(SYSTEMD / "twin.yaml", {}).config.hand == "shadow_hand"
