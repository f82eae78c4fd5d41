"""A stop in real processes: it lasts, it says what it did and what it did not, and nobody else answers for the gate."""

from __future__ import annotations

import json
import signal
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from bridges.client import ask
from bridges.commander import Commander
from bridges.session import open_client
from twin_daemon.hand import load_hand

NS = "shadow_hand"
SLOW_MACHINE = {"heartbeat_s": 2.0, "state_timeout_s": 2.0, "command_age_s": 30.0}


@pytest.mark.slow
def test_a_stop_outlives_the_daemon_and_a_run_that_is_due_does_not_move_the_hand(
    twin: Any, tmp_path: Path, state_dir: Path, until: Any
) -> None:
    config, schedule = tmp_path / "twin.yaml", state_dir / "hands" / NS / "recalibration.json"
    recalibration = {"mode": "active", "cron": "0 3 * * *", "trajectory": "hand_closing", "least_minutes": 0.0}
    config.write_text(yaml.safe_dump({"gate": SLOW_MACHINE, "recalibration": recalibration}))
    schedule.parent.mkdir(parents=True)
    long_ago = datetime.now(UTC) - timedelta(days=3)
    schedule.write_text(json.dumps({"schema": 1, "last": long_ago.isoformat(), "motion_s": 0.0}))
    daemon = twin.start("run", "-c", str(config))
    twin.start("hand", "--trajectory", "none")
    assert twin.run("command", "stop", "--reason", "smoke")[0] == 0
    daemon.send_signal(signal.SIGKILL)
    daemon.communicate()
    twin.start("run", "-c", str(config))
    session = open_client(twin.endpoint, 20.0)
    assert session is not None
    with session:
        commander = Commander(session, load_hand().description)
        status = until(lambda: commander.status(20.0), 20.0)
        assert status["mode"] == "stopped"
        assert "smoke" in status["ended"]
        until(lambda: ask(session, f"twin/{NS}/state", 20.0)["fresh_joints"] == 24, 20.0)
        time.sleep(16.0)  # a run that is due begins when the hand has been at rest for 10 s
        status = commander.status(20.0)
        assert status["mode"] == "stopped"
        assert status["commands_sent"] == 0
        assert not ask(session, f"twin/{NS}/recalibration", 20.0)["running"]
    code, _, err = twin.run("command", "release")
    assert code == 4
    assert "reason" in err
    assert twin.run("command", "release", "--reason", "no smoke")[0] == 0
    assert not (state_dir / "hands" / NS / "stopped.json").exists()
