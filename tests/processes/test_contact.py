"""A running hand with a finger that meets something and a sensor that lies, and a daemon that notices."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.processes.test_command import SLOW_HAND, Scene
from twin_daemon.gate.audit import entries_of

# a stiff stop at 0.3 rad, where the range ends at 1.5708
BLOCKED = "joint_stop:rh_FFJ3=1.2708,stiffness=30"


REVERSED = "reversed:rh_MFJ3"


@pytest.fixture
def scene(twin: Any, tmp_path: Path, state_dir: Path, until: Any) -> Iterator[Scene]:
    gate = SLOW_HAND | {"tracking": {"rh_MFJ3": {"time_s": 0.1}}}  # as it is where nothing is set
    made = Scene(twin, tmp_path, state_dir, "--hidden", BLOCKED, "--fault", REVERSED, gate=gate)
    until(lambda: made.measured, 30.0)
    yield made
    made.close()


@pytest.mark.slow
def test_blocked_finger_and_reversed_sensor_end_the_motion(scene: Scene, until: Any) -> None:
    until(lambda: scene.heard(), 20.0)
    assert scene.twin.run("command", "arm", "--reason", "a test")[0] == 0
    code, out, err = scene.twin.run("command", "move", "rh_FFJ3=1.2", "--json", "-")
    assert code == 4, out
    assert "rh_FFJ3" in err
    assert "from where it was sent" in err
    until(lambda: scene.commander().status()["moving"] is False)
    most = max(effort for _, effort in scene.effort)
    until(lambda: scene.effort[-1][1] < 0.5 * most, 5.0)
    at_most_s = max(at for at, effort in scene.effort if effort > 0.9 * most)
    below_s = min(at for at, effort in scene.effort if at > at_most_s and effort < 0.5 * most)
    print(f"effort {most:.2f} N m at the trip, below half of it {below_s - at_most_s:.3f} s later")
    assert below_s - at_most_s < 0.3
    assert scene.sent[-1].position[0] == pytest.approx(scene.measured["rh_FFJ3"], abs=0.05)
    trips = [entry for entry in entries_of(scene.log) if entry["verb"] == "trip"]
    assert trips[0]["check"] in ("tracking", "frozen")
    armed = next(entry for entry in entries_of(scene.log) if entry["verb"] == "arm")
    assert "effort limit" in json.dumps(armed["warnings"])
    # and one whose sensor counts the wrong way
    assert scene.twin.run("command", "arm", "--reason", "a test")[0] == 0
    code, _, err = scene.twin.run("command", "move", "rh_MFJ3=1.2", "--seconds", "1.5", "--json", "-")
    assert code == 4
    assert "its sensor is reversed" in err
    until(lambda: scene.commander().status()["moving"] is False)
    sent = [one.position[one.names.index("rh_MFJ3")] for one in scene.sent if "rh_MFJ3" in one.names]
    assert max(sent) < 1.0
    assert min(sent) > -0.05
