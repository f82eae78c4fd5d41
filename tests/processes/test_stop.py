"""A stop in real processes: it lasts, it says what it did and what it did not, and nobody else answers for the gate."""

from __future__ import annotations

import json
import shutil
import signal
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client, session_config
from tests.processes.conftest import SLOW_MACHINE
from twin_daemon.gate.audit import entries_of, verify
from twin_daemon.hand import load_hand
from twin_daemon.resources import models_dir
from twin_daemon.security.identity import load_keyring

NS = "shadow_hand"
STOP = f"twin/{NS}/command/stop"


def stopped(twin: Any, *arguments: str) -> tuple[int, dict[str, Any], str]:
    """Exit code, JSON and standard error of `twin command stop`."""
    code, out, err = twin.run("command", "stop", "--json", "-", *arguments)
    return code, json.loads(out), err


def heard(session: Any) -> bool:
    return ask(session, f"twin/{NS}/state", 60.0)["fresh_joints"] == 24


@pytest.mark.slow
def test_a_stop_says_that_somebody_else_moves_the_hand_on_and_believes_the_gate_alone(
    twin: Any, tmp_path: Path, state_dir: Path, until: Any
) -> None:
    twin.start("hand", "--trajectory", "rich_hand")
    daemon = twin.start("run")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: heard(session), 20.0)
        commander = Commander(session, load_hand().description)
        until(lambda: commander.status(20.0)["hand_moves"], 20.0)
        # somebody at the same router says "stopped" in the gate's place
        lie = json.dumps({"schema": 1, "accepted": True, "latched": True, "was_driving": False, "gate": {}})
        impostor = session.declare_queryable(STOP, lambda query: query.reply(STOP, lie), complete=True)
        code, report, err = stopped(twin, "--reason", "a test")
        assert code == 4
        assert "STILL MOVES" in err
        assert (report["latched"], report["was_driving"], report["hand_still_moves"]) == (True, False, True)
        assert report["proved"]
        assert max(report["moved_rad"].values()) > 0.02
        gate = commander.status(20.0)
        assert gate["mode"] == "stopped"
        assert "a test" in gate["ended"]
        operator = Commander(session, load_hand().description, load_keyring(state_dir / "keys.json"), "operator")

        # in whatever form it comes, a stop is one
        forms = [b"smoke!", b"\xff\xfe", b"", b"null", b"[1]", b"{", b'{"reason": 7, "colour": "red"}']
        forms += [json.dumps({"reason": "x" * 100_000}).encode(), b"x" * 5_000_000]
        for form in forms:
            assert operator.ask("release", reason="a test")["accepted"]
            replies = session.get(STOP, payload=form, timeout=10.0, consolidation=zenoh.ConsolidationMode.NONE)
            assert all(json.loads(reply.ok.payload.to_bytes())["accepted"] for reply in replies if reply.ok)
            assert commander.status(20.0)["mode"] == "stopped", form[:40]
        assert operator.ask("release", reason="a test")["accepted"]
        session.put(STOP, "a put", congestion_control=zenoh.CongestionControl.BLOCK)
        until(lambda: "a put" in str(commander.status(20.0)["ended"]))

        # anonymous stops without an end are a few lines, which count them all
        log = state_dir / "hands" / NS / "audit.jsonl"
        before, lines = log.stat().st_size, len(list(entries_of(log)))
        for _ in range(1000):
            session.put(STOP, "again and again", congestion_control=zenoh.CongestionControl.BLOCK)

        def counted() -> int:
            session.put(STOP, "and again", congestion_control=zenoh.CongestionControl.BLOCK)
            return sum(1 + entry.get("repeated", 0) for entry in list(entries_of(log))[lines:])

        until(lambda: counted() >= 1000, 20.0)
        grown = log.stat().st_size - before
        print(f"1000 anonymous stops are {grown} bytes of audit")
        assert grown < 4000
        assert not verify(log).broken
        reasons = [entry.get("reason", "") for entry in entries_of(log) if entry["verb"] == "stop"]
        assert max(map(len, reasons)) == 500

        # without the gate only the impostor answers
        daemon.send_signal(signal.SIGKILL)
        daemon.communicate()
        impostor.undeclare()
    router = zenoh.open(session_config("router", listen=[twin.endpoint]))
    with router:
        router.declare_queryable(STOP, lambda query: query.reply(STOP, lie))
        code, report, err = stopped(twin)
        assert code == 4
        assert "nobody who can prove it is the gate has answered" in err
        assert (report["latched"], report["proved"]) == (False, False)


def test_a_stop_brings_the_gates_own_motion_to_rest_and_says_so(twin: Any, tmp_path: Path, until: Any) -> None:
    config = tmp_path / "twin.yaml"
    config.write_text(yaml.safe_dump({"gate": SLOW_MACHINE}))
    twin.start("run", "-c", str(config))
    twin.start("hand", "--trajectory", "none")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: heard(session), 20.0)
        until(lambda: twin.run("command", "arm", "--reason", "a test")[0] == 0, 20.0)
        moving = twin.start("command", "move", "rh_FFJ3=1.4", "--seconds", "60")
        until(lambda: Commander(session, load_hand().description).status(20.0)["moving"], 20.0)
        code, report, err = stopped(twin)
        assert code == 0, err
        assert (report["latched"], report["was_driving"], report["hand_still_moves"]) == (True, True, False)
        assert report["driver_stop"] is None
        assert twin.finish(moving)[0] == 4
        code, out, _ = twin.run("command", "stop")
        assert code == 0
        assert "no commands of this gate were under way" in " ".join(out.lower().split())


@pytest.mark.slow
def test_the_drivers_own_stop_is_called_and_the_hand_rests(twin: Any, tmp_path: Path, until: Any) -> None:
    shutil.copytree(models_dir() / NS, tmp_path / "models", symlinks=False)
    described = yaml.safe_load((tmp_path / "models" / "hand.yaml").read_text())
    described["stop"] = {"zenoh_key": "driver/halt"}
    description = tmp_path / "models" / "own.yaml"
    description.write_text(yaml.safe_dump(described))
    twin.start("hand", "--hand", str(description), "--trajectory", "rich_hand")
    twin.start("run", "--hand", str(description))
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: heard(session), 20.0)
        until(lambda: Commander(session, load_hand().description).status(20.0)["hand_moves"], 20.0)
        code, report, err = stopped(twin, "--hand", str(description))
        assert code == 0, err
        assert report["hand_still_moves"] is False
        assert report["driver_stop"] == {"what": "key driver/halt", "done": True, "why": None}


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
    twin.query("health", 60.0)
    assert twin.run("command", "stop", "--reason", "smoke")[0] == 0
    daemon.send_signal(signal.SIGKILL)
    daemon.communicate()
    twin.start("run", "-c", str(config))
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        commander = Commander(session, load_hand().description)
        status = until(lambda: commander.status(20.0), 20.0)
        assert status["mode"] == "stopped"
        assert "smoke" in status["ended"]
        until(lambda: ask(session, f"twin/{NS}/state", 60.0)["fresh_joints"] == 24, 20.0)
        time.sleep(13.0)  # a run that is due begins when the hand has been at rest for 10 s
        status = commander.status(20.0)
        assert status["mode"] == "stopped"
        assert status["commands_sent"] == 0
        assert not ask(session, f"twin/{NS}/recalibration", 60.0)["running"]
    code, _, err = twin.run("command", "release")
    assert code == 4
    assert "reason" in err
    assert twin.run("command", "release", "--reason", "no smoke")[0] == 0
    assert not (state_dir / "hands" / NS / "stopped.json").exists()
