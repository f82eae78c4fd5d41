"""The service is installed into a system, brought up to date, and removed, and what people own stays."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from twin_daemon.cli.app import main
from twin_daemon.cli.units import UNITS
from twin_daemon.security.identity import load_keyring

UNIT_FOLDER = "etc/systemd/system"
PROGRAM = "/opt/elsewhere/bin/twin"

needs_systemd = pytest.mark.skipif(
    shutil.which("systemctl") is None or shutil.which("systemd-sysusers") is None,
    reason="systemd is not on this machine",
)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    root = tmp_path / "system"
    (root / "etc").mkdir(parents=True)
    return root


def install(tree: Path, *more: str) -> int:
    return main(["service", "install", "--root", str(tree), "--executable", PROGRAM, *more])


def uninstall(tree: Path) -> int:
    return main(["service", "uninstall", "--root", str(tree)])


def contents(tree: Path) -> set[str]:
    return {str(path.relative_to(tree)) for path in tree.rglob("*") if path.is_file() or path.is_symlink()}


def test_a_dry_run_says_it_all_and_does_nothing(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert install(tree, "--dry-run", "--json", "-") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["done"] is False
    assert any(f"write {tree}/{UNIT_FOLDER}/twin-daemon.service" in step for step in said["steps"])
    assert contents(tree) == set()


@needs_systemd
def test_installed_units_run_this_program_and_start_with_the_machine(tree: Path) -> None:
    assert install(tree) == 0
    for name in UNITS:
        assert "/opt/twin_daemon" not in (tree / UNIT_FOLDER / name).read_text()
    assert (
        f"ExecStart={PROGRAM} run -c /etc/twin_daemon/twin.yaml"
        in (tree / UNIT_FOLDER / "twin-daemon.service").read_text()
    )
    assert (tree / UNIT_FOLDER / "multi-user.target.wants/twin.target").is_symlink()
    assert (tree / UNIT_FOLDER / "twin.target.wants/twin-daemon.service").is_symlink()
    assert "twin:" in (tree / "etc/passwd").read_text()
    assert "operator" in load_keyring(tree / "etc/twin_daemon/keys.json").names


@needs_systemd
def test_after_uninstall_only_keys_and_the_user_are_left(tree: Path) -> None:
    state = tree / "var/lib/twin_daemon/versions"
    state.mkdir(parents=True)
    (state / "one").write_text("learned")
    assert install(tree) == 0
    assert uninstall(tree) == 0
    left = contents(tree) - {"etc/passwd", "etc/group", "etc/shadow", "etc/gshadow", "etc/.pwd.lock"}
    assert left == {"etc/twin_daemon/keys.json", "var/lib/twin_daemon/versions/one"}
    assert uninstall(tree) == 3


@needs_systemd
def test_an_upgrade_keeps_configuration_keys_and_edits(tree: Path) -> None:
    assert install(tree) == 0
    config, keys = tree / "etc/twin_daemon/twin.yaml", tree / "etc/twin_daemon/keys.json"
    unit, secret = tree / UNIT_FOLDER / "twin-daemon.service", keys.read_bytes()
    config.write_text("hand: shadow_hand\nnamespace: left\n")
    unit.write_text(unit.read_text() + "# mine\n")
    assert install(tree) == 0
    assert "left" in config.read_text()
    assert keys.read_bytes() == secret
    assert "# mine" not in unit.read_text()
    assert "# mine" in unit.with_name("twin-daemon.service.saved").read_text()
    assert uninstall(tree) == 0
    assert "left" in config.read_text()


@needs_systemd
def test_the_keys_of_a_daemon_of_before_are_taken_along(tree: Path) -> None:
    before = tree / "var/lib/twin_daemon/keys.json"
    before.parent.mkdir(parents=True)
    identities = {"schema": 1, "identities": {"anna": {"role": "operator", "key": "ab" * 32}}}
    before.write_text(json.dumps(identities))
    before.chmod(0o600)
    assert install(tree) == 0
    assert load_keyring(tree / "etc/twin_daemon/keys.json").names == ("anna", "workbench", "bridge")


def test_a_path_that_a_unit_cannot_name_is_refused() -> None:
    from twin_daemon.cli.units import require_readable
    from twin_daemon.errors import BadInput

    for path in ("/home/anna/.venv/bin/twin", "/opt/my twin/bin/twin", "/tmp/bin/twin"):
        with pytest.raises(BadInput):
            require_readable(Path(path))
    require_readable(Path("/opt/twin_daemon/.venv/bin/twin"))


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_without_rights_it_says_who_may(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tree / "etc").chmod(0o500)
    assert install(tree) == 3
    assert "only root may do this" in capsys.readouterr().err


@pytest.mark.skipif(Path("/run/systemd/system").is_dir(), reason="systemd runs here")
@pytest.mark.parametrize("command", ["status", "logs"])
def test_where_systemd_does_not_run_it_says_so(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["service", command]) == 5
    assert "systemd does not run" in capsys.readouterr().err


def test_the_boot_test_leaves_out_what_this_machine_cannot(tmp_path: Path) -> None:
    """Without its tools on the path it is one plain line, and no failure."""
    script = Path(__file__).resolve().parents[2] / "tools" / "boot_test.sh"
    tools = tmp_path / "bin"
    tools.mkdir()
    for name in ("bash", "dirname", "realpath", "id"):
        (tools / name).symlink_to(str(shutil.which(name)))
    environment = {"PATH": str(tools), "PYTHON": sys.executable, "BOOT_CACHE": str(tmp_path / "cache")}
    done = subprocess.run([tools / "bash", script], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("boot test left out: ")
    assert len(done.stdout.splitlines()) == 1
