"""A motion that begins by itself, as ROS 2 is told of it, and cancelled from there."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from tests.bridges.ros_network import Peer, needs_ros
from tests.bridges.test_ros2_commands import NS, Scene, call
from tests.processes.conftest import Twin, until
from tests.processes.test_automatic import ACTIVE
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import load_keyring

pytestmark = needs_ros

COUNTDOWN_S = 20.0


@pytest.fixture
def scene(twin: Twin, tmp_path: Path, state_dir: Path) -> Any:
    made = Scene(twin, tmp_path, state_dir, recalibration=ACTIVE | {"countdown_s": COUNTDOWN_S})
    until(lambda: made.measured, 60.0)
    yield made
    made.close()


@pytest.mark.slow
def test_the_diagnostics_count_down_and_anybody_cancels(
    scene: Scene, peers: tuple[Peer, Peer], state_dir: Path
) -> None:
    _, operator = peers
    day = f"{datetime.now(UTC) + timedelta(days=30):%Y-%m-%d}"
    assert scene.twin.run("consent", "give", "--name", "Ann Example", "--until", day)[0] == 0
    # without an identity of its own, and a period that would come too late: what is announced is told at once
    scene.twin.start("bridge", "ros2", "--ros-args", "-p", "diagnostics_period_s:=2.0")

    def told() -> dict[str, Any] | None:
        heard = [one["automatic"] for one in operator.do("take")["diagnostics"] if "automatic" in one]
        return heard[-1] if heard else None

    quiet = until(told, 60.0)
    assert (quiet["level"], quiet["message"]) == (0, "no automatic motion")
    until(lambda: "no automatic motion is announced" in call(operator, "cancel")["message"], 20.0)

    commander = Commander(scene.session, load_hand().description, load_keyring(state_dir / "keys.json"), "operator")
    until(lambda: (a := commander.ask("recalibrate"))["accepted"] or a["why"].endswith("announced"), 40.0)
    warned = until(lambda: (one := told()) and one["level"] == 1 and one, 15.0)
    assert "the hand moves by itself in" in warned["message"]
    assert warned["values"]["phase"] == "announced"
    assert 0.0 < float(warned["values"]["begins_in_s"]) <= COUNTDOWN_S
    cancelled = call(operator, "cancel")
    assert (cancelled["success"], cancelled["message"]) == (True, "cancelled; what moved comes to rest")
    after = until(lambda: (one := told()) and one["level"] == 0 and one, 10.0)
    assert after["message"] == "no automatic motion"
    texts = [one["text"] for one in ask(scene.session, f"twin/{NS}/events")["events"] if one["kind"] == "automatic"]
    assert "cancel over ROS 2" in texts[-1]
    assert scene.gate()["commands_sent"] == 0
