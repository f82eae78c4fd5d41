"""Daemon and workbench as the units run them: users of their own, of whom the workbench's can look and stop."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.cli.test_root import PYTHON, SERVICE, pytestmark  # noqa: F401 - it needs what those tests need
from twin_daemon.cli.children import free_port
from twin_daemon.cli.unit_identities import hand_out, with_unit_identities
from twin_daemon.resources import twin_command
from twin_daemon.security.identity import KEYS, ensure_keyring

WORKBENCH = SERVICE + 1
TRY = """
import json, sys
from pathlib import Path
opened = []
for path in map(Path, sys.argv[1:]):
    plant = lambda: (path / "planted").write_text("x")
    for how in (path.read_bytes, lambda: path.open("ab").close(), plant, path.unlink):
        try:
            how()
            opened.append(str(path))
        except OSError:
            pass
print(json.dumps(opened))
"""


class Units:
    """A machine with /etc and /var of its own, and processes as the units start them."""

    def __init__(self, base: Path) -> None:
        base.chmod(0o755)
        self.etc, self.state, self.own = base / "etc", base / "twin_daemon", base / "twin_workbench"
        self.etc.mkdir()
        for folder, user in ((self.state, SERVICE), (self.own, WORKBENCH)):
            folder.mkdir(mode=0o750)
            os.chown(folder, user, user)
        self.keys = self.etc / KEYS
        keyring = with_unit_identities(ensure_keyring(self.keys))
        keyring.save(self.keys)
        passwd = base / "passwd"
        lines = [("twin-workbench", WORKBENCH), ("twin-bridge", WORKBENCH + 1)]
        passwd.write_text("".join(f"{name}:x:{number}:{number}:::\n" for name, number in lines))
        hand_out(self.keys, keyring, passwd, {})
        credential = base / "credentials"
        credential.mkdir(mode=0o700)
        shutil.copy(self.keys, credential / KEYS)
        for path in (credential, credential / KEYS):
            os.chown(path, SERVICE, SERVICE)
        self._of_all = {"TWIN_STATE_DIR": str(self.state), "TWIN_ENDPOINT": f"tcp/127.0.0.1:{free_port()}"}
        self._of = {
            SERVICE: {"TWIN_KEYS": str(credential / KEYS)},
            WORKBENCH: {"TWIN_AS": "workbench", "TWIN_SECURITY": str(self.etc / "identities/workbench")},
        }
        self._running: list[subprocess.Popen[str]] = []

    def start(self, user: int, *arguments: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [str(PYTHON), *arguments],
            cwd="/",
            env={
                **{name: value for name, value in os.environ.items() if not name.startswith("TWIN_")},
                "PYTHONPATH": os.pathsep.join(path for path in sys.path if path),
                "HOME": "/nonexistent",
                **self._of_all,
                **self._of[user],
            },
            user=user,
            group=user,
            extra_groups=[SERVICE],
            umask=0o027,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._running.append(process)
        return process

    def twin(self, user: int, *arguments: str) -> subprocess.Popen[str]:
        return self.start(user, *twin_command(*arguments)[1:])

    def close(self) -> None:
        for process in self._running:
            if process.poll() is None:
                process.kill()
            process.communicate()


@pytest.fixture
def units() -> Iterator[Units]:
    base = Path(tempfile.mkdtemp(prefix="twin-units-", dir="/tmp"))
    made = Units(base)
    yield made
    made.close()
    shutil.rmtree(base)


@pytest.mark.slow
def test_code_in_the_workbench_sees_what_was_recorded_and_commands_nothing(units: Units, until: Any) -> None:
    units.twin(SERVICE, "run")
    units.twin(SERVICE, "hand", "--trajectory", "rich_finger")
    page = units.twin(WORKBENCH, "workbench", "--port", "0")
    assert page.stdout is not None
    said = [page.stdout.readline() for _ in range(3)]
    address, token = said[1].split()[-1].rstrip("/"), said[2].partition("#token=")[2].strip()

    def ask(path: str, body: dict[str, Any] | None = None) -> tuple[int, Any]:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(address + path, data, {"X-Twin-Token": token})
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return answer.status, json.load(answer)
        except urllib.error.HTTPError as error:
            with error:
                return error.code, json.load(error)

    kept = until(lambda: (found := ask("/api/keep", {}))[0] == 200 and found[1]["kept"] and found[1], 60.0)
    assert kept["messages"] > 0
    (offer,) = ask("/api/recordings")[1]["recordings"]
    status, opened = ask(f"/api/recording?recording={offer['id']}")
    assert (status, opened.get("samples", 0) > 0) == (200, True), opened
    assert ask("/api/versions")[0] == 200
    status, refused = ask("/api/versions/promote", {"version": "nominal", "reason": "a test"})
    assert status == 400, refused
    assert "bug" not in refused["error"]
    status, refused = ask("/api/release", {"reason": "a test"})
    assert status == 400
    assert "no operator's key is here" in refused["error"]
    assert ask("/api/stop", {"reason": "anybody may"})[0] == 200
    # a person logs in with his own key, for one request; the gate says whether it is his
    his = json.loads(units.keys.read_text())["identities"]["operator"]["key"]
    wrong = {"reason": "a test", "name": "operator", "key": "ab" * 32}
    status, answer = ask("/api/release", wrong)
    assert not answer.get("accepted"), answer
    status, answer = ask("/api/release", {"reason": "a test", "name": "operator", "key": "no key"})
    assert (status, "no key" in answer["error"]) == (400, True)
    status, answer = ask("/api/release", wrong | {"key": his})
    assert (status, answer.get("accepted")) == (200, True), answer

    everything = [units.keys, units.state, *(path for path in units.state.rglob("*") if path.is_dir())]
    secret = [path for path in units.state.rglob("*") if path.is_file() and path.stat().st_mode & 0o040 == 0]
    written = [path for path in units.state.rglob("*") if path.is_file()]
    tried = units.start(WORKBENCH, "-c", TRY, *map(str, [*everything, *secret]))
    assert json.loads(tried.communicate(timeout=60)[0]) == []
    tried = units.start(WORKBENCH, "-c", TRY.replace("path.read_bytes,", ""), *map(str, written))
    assert json.loads(tried.communicate(timeout=60)[0]) == []
    assert (units.etc / "identities/workbench" / KEYS).stat().st_uid == WORKBENCH
