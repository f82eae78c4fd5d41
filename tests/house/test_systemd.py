"""The units are what systemd accepts, and keep their protections."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from twin_daemon.cli import units
from twin_daemon.daemon.configuration import load_config
from twin_daemon.resources import step_back

SYSTEMD = Path(__file__).resolve().parents[2] / "systemd"
SERVICES = sorted(path.name for path in SYSTEMD.glob("*.service"))
MOST_EXPOSED = 15  # of 100, as systemd-analyze counts

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not on this machine")


def analyze(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["systemd-analyze", *arguments], capture_output=True, text=True)


@needs_systemd
def test_systemd_accepts_the_units(tmp_path: Path) -> None:
    paths = []
    for file in units.planned(Path(sys.executable)):
        if file.place.name in units.UNITS:
            paths.append(tmp_path / file.place.name)
            paths[-1].write_bytes(file.content)
    assert len(paths) == 5
    done = analyze("verify", "--man=no", "--recursive-errors=no", *map(str, paths))
    complaints = [line for line in done.stderr.splitlines() if any(name in line for name in units.UNITS)]
    assert not complaints
    assert done.returncode == 0


@needs_systemd
@pytest.mark.parametrize("name", SERVICES)
def test_a_unit_keeps_its_protections(name: str) -> None:
    done = analyze("security", "--offline=true", f"--threshold={MOST_EXPOSED}", "--no-pager", str(SYSTEMD / name))
    assert done.returncode == 0, done.stdout.splitlines()[-1]


def test_every_unit_of_the_folder_is_installed() -> None:
    assert {*SERVICES, *(path.name for path in SYSTEMD.glob("*.target"))} == set(units.UNITS)


def test_the_configuration_that_comes_with_it_is_valid() -> None:
    assert load_config(SYSTEMD / "twin.yaml", {}).config.hand == "shadow_hand"


def test_what_calibrates_gives_way_to_the_loop() -> None:
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        step_back(child.pid, 19)
        assert os.getpriority(os.PRIO_PROCESS, child.pid) == 19
        assert Path(f"/proc/{child.pid}/oom_score_adj").read_text().strip() == "1000"
        child.communicate(b"\n")


def settings_of(name: str) -> dict[str, list[str]]:
    """What a unit sets, each key with all of its values."""
    lines = [line.strip() for line in (SYSTEMD / name).read_text().splitlines() if not line.startswith(("#", "["))]
    found: dict[str, list[str]] = {}
    for key, _, value in (line.partition("=") for line in lines if line):
        found.setdefault(key, []).append(value)
    return found


def test_every_unit_has_a_user_of_its_own_and_the_daemons_alone_have_all_keys() -> None:
    found = {name: settings_of(name) for name in SERVICES}
    outside = {"twin-workbench.service": "workbench", "twin-bridge-ros2.service": "bridge"}
    users = [found[name]["User"][0] for name in outside]
    assert len({*users, *(one["User"][0] for name, one in found.items() if name not in outside)}) > len(users)
    assert len(set(users)) == len(users)
    made = (SYSTEMD / "twin-daemon.sysusers.conf").read_text()
    for name, identity in outside.items():
        one = found[name]
        said = " ".join(one["Environment"])
        assert one["User"] == one["Group"] == [f"twin-{identity}"]
        assert f"u twin-{identity} " in made
        assert "LoadCredential" not in one
        assert f"TWIN_AS={identity}" in said
        assert f"TWIN_SECURITY=/etc/twin_daemon/identities/{identity}" in said
        assert "keys.json" not in said
        assert "twin_daemon" not in one.get("StateDirectory", [])
