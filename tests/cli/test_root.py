"""What root does in the folders of a service's user, who may have put links there, is done with that user's rights."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from twin_daemon.privileges import owner_on_the_way
from twin_daemon.resources import twin_command
from twin_daemon.security.identity import load_keyring

SERVICE = 64_321  # nobody's number


def readable_python() -> str | None:
    """This Python, or another of its version, where everybody may read it."""
    probe = "import json, sys; sys.exit(sys.version_info[:2] != ({}, {}))".format(*sys.version_info[:2])
    for python in (sys.executable, f"/usr/bin/python3.{sys.version_info.minor}"):
        with contextlib.suppress(OSError):
            if subprocess.run([python, "-c", probe], user=SERVICE, cwd="/", capture_output=True).returncode == 0:
                return python
    return None


PYTHON = readable_python() if os.geteuid() == 0 else None
pytestmark = pytest.mark.skipif(PYTHON is None, reason="it needs root, and a Python that other users can read")


def run(*arguments: str, user: int | None = None, **environment: str) -> subprocess.CompletedProcess[str]:
    """`twin ARGUMENTS` of root, or of a user and his group alone."""
    _, *words = twin_command(*arguments)
    return subprocess.run(
        [str(PYTHON), *words],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path), **environment},
        user=user,
        group=user,
        extra_groups=None if user is None else [],
        capture_output=True,
        text=True,
    )


class Machine:
    """A service's state folder, root's folder of keys, and something of root's that must stay as it is."""

    def __init__(self, base: Path) -> None:
        base.chmod(0o755)
        self.state, self.etc, self.treasure = base / "state", base / "etc", base / "treasure"
        self.state.mkdir(mode=0o750)
        os.chown(self.state, SERVICE, SERVICE)
        self.etc.mkdir(mode=0o755)
        self.treasure.mkdir(mode=0o700)
        (self.treasure / "secret").write_text("root's password\n")
        (self.treasure / "key.pem").write_text("root's key\n")

    def plant(self, name: str, target: Path) -> None:
        link = self.state / name
        link.parent.mkdir(parents=True, exist_ok=True)
        link.symlink_to(target)
        for path in (link, *link.parents):
            if path.is_relative_to(self.state):
                os.chown(path, SERVICE, SERVICE, follow_symlinks=False)

    def twin(self, *arguments: str, **more: str) -> subprocess.CompletedProcess[str]:
        return run(*arguments, TWIN_STATE_DIR=str(self.state), **{"TWIN_KEYS": str(self.etc / "keys.json"), **more})

    def fingerprint(self) -> list[tuple[object, ...]]:
        found = [self.treasure, *sorted(self.treasure.rglob("*"))]
        told = [(path, path.lstat()) for path in found]
        return [(path.name, one.st_uid, one.st_gid, one.st_mode, one.st_size, one.st_mtime_ns) for path, one in told]


@pytest.fixture
def machine() -> Iterator[Machine]:
    base = Path(tempfile.mkdtemp(prefix="twin-root-", dir="/tmp"))  # pytest's own folder lets nobody else through
    yield Machine(base)
    shutil.rmtree(base)


def test_what_root_makes_belongs_to_the_service_but_the_authority_and_the_keys(machine: Machine) -> None:
    done = machine.twin("security", "init")
    assert done.returncode == 0, done.stderr
    assert machine.twin("security", "add", "ann").returncode == 0
    for path in (machine.etc / "keys.json", machine.etc / "authority" / "key.pem"):
        assert (path.stat().st_uid, stat.S_IMODE(path.stat().st_mode)) == (0, 0o600)
    made = list((machine.state / "security").rglob("*"))
    assert {path.name for path in (machine.state / "security").iterdir()} >= {"daemon", "ann", "viewer"}
    assert {path.stat().st_uid for path in made} == {SERVICE}
    secret = (machine.etc / "authority" / "key.pem").read_text()
    assert all(path.read_text() != secret for path in made if path.is_file())
    shown = json.loads(machine.twin("security", "show", "--json", "-").stdout)
    assert all(one["valid"] for one in shown["identities"])
    assert machine.twin("security", "remove", "ann").returncode == 0
    assert not (machine.state / "security" / "ann").exists()


@pytest.mark.parametrize(
    ("link", "target"),
    [
        ("security", ""),
        ("security/daemon", ""),
        ("security/daemon/key.pem", "key.pem"),
        ("security/left", "secret"),
    ],
)
def test_a_planted_link_leads_root_nowhere(machine: Machine, link: str, target: str) -> None:
    machine.plant(link, machine.treasure / target)
    before = machine.fingerprint()
    done = machine.twin("security", "init")
    assert machine.fingerprint() == before
    assert "Traceback" not in done.stderr
    assert done.returncode in (0, 3), done.stderr
    assert "root's" not in done.stdout + done.stderr


def test_an_authority_that_the_service_could_read_is_replaced(machine: Machine) -> None:
    made = run("security", "init", user=SERVICE, TWIN_STATE_DIR=str(machine.state))
    assert made.returncode == 0, made.stderr
    before = (machine.state / "security" / "authority" / "key.pem").read_bytes()
    done = machine.twin("security", "init")
    assert done.returncode == 0, done.stderr
    assert "could read it" in done.stdout
    assert not (machine.state / "security" / "authority").exists()
    assert (machine.etc / "authority" / "key.pem").read_bytes() != before
    assert all(one["valid"] for one in json.loads(machine.twin("security", "show", "--json", "-").stdout)["identities"])


def test_an_authority_can_be_put_away(machine: Machine) -> None:
    stick = machine.treasure / "stick"
    assert machine.twin("security", "init", TWIN_AUTHORITY=str(stick)).returncode == 0
    assert (stick / "key.pem").is_file()
    assert not (machine.etc / "authority").exists()
    shutil.rmtree(stick)
    assert machine.twin("security", "show").returncode == 0


@pytest.mark.parametrize("link", ["hands", "hands/shadow_hand"])
def test_other_commands_of_root_follow_no_link_either(machine: Machine, link: str) -> None:
    machine.plant(link, machine.treasure)
    before = machine.fingerprint()
    done = machine.twin("versions", "promote", "nominal", "--reason", "a test")
    assert "Traceback" not in done.stderr
    assert "root's" not in done.stdout + done.stderr
    assert machine.fingerprint() == before


def test_keys_of_before_are_taken_from_a_plain_file_alone(machine: Machine) -> None:
    tree = machine.state.parent / "tree"
    (tree / "etc").mkdir(parents=True)
    (tree / "var/lib").mkdir(parents=True)
    machine.state.rename(tree / "var/lib/twin_daemon")
    machine.state = tree / "var/lib/twin_daemon"
    secret = machine.treasure / "keys.json"
    identities = {"schema": 1, "identities": {"root": {"role": "operator", "key": "cd" * 32}}}
    secret.write_text(json.dumps(identities))
    secret.chmod(0o600)
    machine.plant("keys.json", secret)
    machine.plant("security/workbench", machine.treasure)
    done = machine.twin("service", "install", "--root", str(tree), "--executable", "/opt/twin")
    assert done.returncode == 3
    assert "no plain file" in done.stderr
    assert not (tree / "etc/twin_daemon/keys.json").exists()
    (machine.state / "keys.json").unlink()
    if shutil.which("systemctl") is None or shutil.which("systemd-sysusers") is None:
        return
    done = machine.twin("service", "install", "--root", str(tree), "--executable", "/opt/twin")
    assert done.returncode == 3, done.stdout  # the treasure has a key.pem
    assert "no plain file" in done.stderr
    assert not (tree / "etc/twin_daemon/identities").exists()
    (machine.state / "security" / "workbench").unlink()
    done = machine.twin("service", "install", "--root", str(tree), "--executable", "/opt/twin")
    assert done.returncode == 0, done.stderr
    users = dict(line.split(":")[0:3:2] for line in (tree / "etc/passwd").read_text().splitlines())
    given = {name: tree / "etc/twin_daemon/identities" / name for name in ("workbench", "bridge")}
    for name, folder in given.items():
        told = (folder / "keys.json").stat()
        assert (str(told.st_uid), stat.S_IMODE(told.st_mode)) == (users[f"twin-{name}"], 0o600)
        assert (folder.stat().st_uid, stat.S_IMODE(folder.stat().st_mode)) == (0, 0o750)
    keyring = {name: load_keyring(folder / "keys.json") for name, folder in given.items()}
    assert {name: [(one, ring.role(one)) for one in ring.names] for name, ring in keyring.items()} == {
        "workbench": [("workbench", "viewer")],
        "bridge": [("bridge", "hand")],
    }
    assert len({users[user] for user in ("twin", "twin-workbench", "twin-bridge")}) == 3


def test_whose_word_counts_on_the_way(machine: Machine) -> None:
    assert owner_on_the_way(machine.etc / "keys.json") is None
    assert owner_on_the_way(machine.state / "security" / "x") == (SERVICE, SERVICE)
    (machine.etc / "there").symlink_to(machine.state)
    assert owner_on_the_way(machine.etc / "there" / "x") == (SERVICE, SERVICE)
