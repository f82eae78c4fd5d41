"""What the daemon tells its service manager: ready, alive while loop and gate turn, reloading; and what it reloads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.gatekeeper import Gatekeeper
from bridges.zenoh.session import open_client, session_config
from tests.processes.manager import Manager
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.gate.audit import AuditLog
from twin_daemon.gate.gate import Gate
from twin_daemon.gate.settings import GateSettings
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import ensure_keyring, load_keyring
from twin_daemon.services.register import Register
from twin_daemon.simulation.twin import TwinModel

NS = "shadow_hand"
PERIOD_S = 0.4
# the loop hangs for good in the first command that it gets
HANGING = (
    "import sys, threading\n"
    "from twin_daemon.daemon.service import TwinService\n"
    "TwinService.on_command = lambda *_: threading.Event().wait()\n"
    "from twin_daemon.cli.app import main\n"
    "sys.exit(main())\n"
)


@pytest.fixture
def manager(monkeypatch: pytest.MonkeyPatch) -> Iterator[Manager]:
    made = Manager()
    monkeypatch.setenv("NOTIFY_SOCKET", made.name)
    monkeypatch.setenv("WATCHDOG_USEC", str(int(PERIOD_S * 1e6)))
    yield made
    made.socket.close()


def test_ready_alive_and_stopping_are_told(manager: Manager, twin: Any) -> None:
    daemon = twin.start("run")
    assert manager.hear("READY=1") == ["READY=1"]
    assert len(manager.hear("WATCHDOG=1")) == 1
    assert twin.query("version")["id"] == "nominal"
    manager.waiting()
    assert twin.end(daemon)[0] == 0
    assert "STOPPING=1" in manager.waiting()


def test_a_loop_that_hangs_starves_the_watchdog(manager: Manager, twin: Any) -> None:
    environment = {**os.environ, "TWIN_ENDPOINT": twin.endpoint, "PYTHONPATH": os.pathsep.join(sys.path)}
    daemon = subprocess.Popen([sys.executable, "-c", HANGING, "run"], env=environment, stderr=subprocess.DEVNULL)
    try:
        manager.hear("WATCHDOG=1")
        session = open_client(twin.endpoint, 60.0)
        assert session is not None
        with session:
            session.put(f"{NS}/joint_commands", cdr.encode(JointSample(0, ("rh_FFJ3",), np.zeros(1))))
            while True:  # until a whole period has passed without a word
                session.put(f"{NS}/joint_commands", cdr.encode(JointSample(0, ("rh_FFJ3",), np.zeros(1))))
                manager.waiting()
                time.sleep(2 * PERIOD_S)
                if not manager.waiting():
                    break
            # the transport's threads still answer: only the loop hangs
            assert ask(session, f"twin/{NS}/version")["id"] == "nominal"
        assert daemon.poll() is None
    finally:
        daemon.kill()
        daemon.wait()


def test_a_gate_that_hangs_does_too(tmp_path: Path) -> None:
    hand = load_hand()
    gate = Gate(TwinModel.load(hand), GateSettings(), session="s")
    with zenoh.open(session_config("peer")) as session:
        audit = AuditLog(tmp_path / "audit.jsonl")
        register = Register(audit, lambda *_: None)
        keeper = Gatekeeper(session, gate, register, ensure_keyring(tmp_path / "keys.json"), hand.description)
        try:
            assert keeper.turns(within_s=5.0)
            with gate._lock:  # as somebody would who never lets go of it
                deadline_s = time.monotonic() + 20.0
                while keeper.turns(within_s=1.0):
                    assert time.monotonic() < deadline_s
                    time.sleep(0.05)
            while not keeper.turns(within_s=1.0):
                assert time.monotonic() < deadline_s + 20.0
                time.sleep(0.05)
        finally:
            keeper.close()
            audit.close()


def test_a_reload_takes_over_what_it_can_and_says_what_it_cannot(manager: Manager, twin: Any, tmp_path: Path) -> None:
    config = tmp_path / "twin.yaml"
    config.write_text("daemon: {residual_window_s: 5}\n")
    daemon = twin.start("run", "-c", str(config))
    manager.hear("READY=1")
    for text in ("daemon: {horizon_s: 0.7, residual_window_s: 9}\n", "daemon: {horizn_s: 1}\n"):
        config.write_text(text)
        daemon.send_signal(signal.SIGHUP)
        assert "MONOTONIC_USEC=" in manager.hear("RELOADING=1")[-1]
        manager.hear("READY=1")
    assert twin.query("state")["status"] == "waiting"
    code, _, log = twin.end(daemon)
    assert code == 0
    assert "taken over: daemon.horizon_s" in log
    assert "needs a restart: daemon.residual_window_s" in log
    assert "not taken over" in log
    assert "Did you mean 'horizon_s'?" in log


def test_keys_as_a_credential_are_read_and_others_must_be_private(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from twin_daemon.errors import BadInput

    path = tmp_path / "keys.json"
    ensure_keyring(path)
    path.chmod(0o440)  # as systemd's credentials look: the group's bits are the mask of their access list
    with pytest.raises(BadInput, match="others can read"):
        load_keyring(path)
    monkeypatch.setenv("CREDENTIALS_DIRECTORY", str(tmp_path))
    assert "operator" in load_keyring(path).names
    path.chmod(0o444)
    with pytest.raises(BadInput, match="others can read"):
        load_keyring(path)
