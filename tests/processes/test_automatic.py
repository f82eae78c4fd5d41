"""Motion that begins by itself: with consent, on a free gate, announced, and cancelled by anybody."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
import yaml

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client
from tests.processes.test_command import NS, SLOW_HAND, Scene
from twin_daemon.gate.audit import entries_of
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import load_keyring

ACTIVE = {"mode": "active", "on_drift": False, "countdown_s": 5.0, "trajectory": "hand_closing", "nice": 0}


@pytest.fixture
def scene(twin: Any, tmp_path: Path, state_dir: Path) -> Iterator[Scene]:
    made = Scene(twin, tmp_path, state_dir, recalibration=ACTIVE)
    yield made
    made.close()


def test_the_hand_moves_by_itself_only_with_consent_and_until_anybody_cancels(scene: Scene, until: Any) -> None:
    twin = scene.twin
    told: list[dict[str, Any]] = []
    lamp = scene.session.declare_subscriber(
        f"twin/{NS}/announcement", lambda sample: told.append(json.loads(sample.payload.to_bytes()))
    )
    until(lambda: scene.measured and scene.heard(), 30.0)
    operator = scene.commander()
    assert "nobody has consented" in operator.ask("recalibrate")["why"]
    until_day = f"{datetime.now(UTC) + timedelta(days=30):%Y-%m-%d}"
    code, _, err = twin.run("consent", "give", "--name", "Ann Example", "--until", until_day)
    assert code == 0, err
    assert json.loads(twin.run("consent", "show", "--json", "-")[1])["person"] == "Ann Example"

    # the hand is somebody else's: nothing of the twin's own overrides that
    scene.armed(until)
    assert "gate is not free: armed by operator" in operator.ask("recalibrate")["why"]
    assert twin.run("command", "disarm")[0] == 0
    assert told == []

    def announced() -> None:
        until(lambda: (answer := operator.ask("recalibrate"))["accepted"] or answer["why"].endswith("announced"), 30.0)
        until(lambda: told and told[-1]["phase"] == "announced", 5.0)

    announced()
    assert "Ann Example" in ask(scene.session, f"twin/{NS}/recalibration")["consent"]
    code, out, _ = twin.run("command", "cancel", "--reason", "my finger is in there", "--json", "-")
    assert code == 0
    assert json.loads(out)["cancelled"], ask(scene.session, f"twin/{NS}/events")["events"][-4:]
    until(lambda: told[-1]["phase"] == "none", 5.0)
    assert not json.loads(twin.run("command", "cancel", "--json", "-")[1])["cancelled"]

    announced()
    assert Commander(scene.session, scene.description).ask("stop", reason="smoke")["accepted"]
    assert operator.ask("release", reason="no smoke")["accepted"]  # at once, and the stop has counted all the same
    until(lambda: told[-1]["phase"] == "none", 5.0)
    time.sleep(ACTIVE["countdown_s"])
    assert scene.sent == []
    assert operator.status()["commander"] is None

    announced()
    left_s = [one["begins_in_s"] for one in told if one["phase"] == "announced"]
    assert 4.0 < max(left_s) <= 5.0
    until(lambda: told[-1]["phase"] == "moving" and scene.sent, 60.0)
    assert operator.status()["commander"] == "automatic"
    assert operator.ask("arm", reason="mine")["check"] == "commander"
    assert twin.run("consent", "withdraw")[0] == 0
    until(lambda: operator.status()["mode"] == "read_only" and told[-1]["phase"] == "none", 20.0)

    def said() -> list[str]:
        events = ask(scene.session, f"twin/{NS}/events")["events"]
        return [event["text"] for event in events if event["kind"] == "automatic"]

    # the lamp may be out before the event of it is written
    until(lambda: [text.split(":")[0] for text in said()].count("the hand does not move by itself") == 3, 10.0)
    texts = said()
    assert "my finger is in there" in " ".join(texts)
    assert "stop (smoke)" in " ".join(texts)
    assert [entry["who"] for entry in entries_of(scene.log) if entry["verb"] == "trajectory"] == ["automatic"]
    lamp.undeclare()


def test_quiet_hours_hold_for_whoever_asks(twin: Any, tmp_path: Path, state_dir: Path, until: Any) -> None:
    now = datetime.now(UTC)
    quiet = f"{now - timedelta(hours=1):%H:%M}-{now + timedelta(hours=1):%H:%M}"
    config = tmp_path / "twin.yaml"
    config.write_text(yaml.safe_dump({"gate": SLOW_HAND, "recalibration": ACTIVE | {"quiet": quiet}}))
    twin.start("run", "-c", str(config))
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        assert ask(session, f"twin/{NS}/recalibration", 60.0)["mode"] == "active"
        operator = Commander(session, load_hand().description, load_keyring(state_dir / "keys.json"), "operator")
        refused = operator.ask("recalibrate")
        assert not refused["accepted"]
        assert "quiet hours" in refused["why"]
