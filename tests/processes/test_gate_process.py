"""The gate is a process of its own: it sees for itself that the hand, the daemon or the commander is lost."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Any

import psutil
import pytest

from tests.processes.test_command import Scene
from twin_daemon.gate.audit import entries_of, verify


@pytest.fixture
def scene(twin: Any, tmp_path: Path, state_dir: Path, until: Any) -> Any:
    made = Scene(twin, tmp_path, state_dir)
    until(lambda: made.measured, 30.0)
    yield made
    made.close()


def gate_of(scene: Scene) -> psutil.Process:
    children = psutil.Process(scene.daemon.pid).children()
    return next(child for child in children if "gate" in child.cmdline())


def test_a_daemon_that_hangs_ends_the_motion_and_a_stop_is_taken_meanwhile(scene: Scene, until: Any) -> None:
    commander = scene.armed(until)
    moving = scene.twin.start("command", "move", "rh_FFJ3=1.4", "--seconds", "60")
    until(lambda: len(scene.sent) > 20, 30.0)
    os.kill(scene.daemon.pid, signal.SIGSTOP)
    try:
        # the daemon stands still, the gate does not
        ended = until(lambda: (s := commander.status(20.0))["mode"] == "read_only" and s["ended"], 20.0)
        assert "the daemon has been silent" in ended
        assert scene.twin.finish(moving)[0] == 4
        refused = commander.ask("arm", reason="a test")
        assert (refused["accepted"], refused["check"]) == (False, "daemon")
        report = commander.stop("a test")
        assert (report["latched"], report["was_driving"]) == (True, False)
    finally:
        os.kill(scene.daemon.pid, signal.SIGCONT)
    assert commander.status(20.0)["mode"] == "stopped"
    assert [entry["check"] for entry in entries_of(scene.log) if entry["verb"] == "trip"] == ["daemon"]


@pytest.mark.slow
def test_a_gate_that_dies_is_replaced_and_one_whose_daemon_dies_ends(scene: Scene, until: Any) -> None:
    commander = scene.armed(until)
    first = gate_of(scene)
    assert commander.ask("move", targets={"rh_FFJ3": 1.4}, seconds=60.0)["accepted"]
    until(lambda: len(scene.sent) > 20, 30.0)
    first.send_signal(signal.SIGKILL)
    until(lambda: not _sends(scene), 5.0)
    second = until(lambda: [one for one in [_gate_or_none(scene)] if one and one.pid != first.pid], 30.0)[0]
    status = until(lambda: (s := scene.commander().status(20.0))["session"] and s, 30.0)
    assert (status["mode"], status["commands_sent"]) == ("read_only", 0)
    commander = until(lambda: scene.armed(until), 30.0)
    count = len(scene.sent)
    assert commander.ask("move", targets={"rh_FFJ3": 0.1}, seconds=20.0)["accepted"]
    until(lambda: len(scene.sent) > count + 10, 30.0)
    os.kill(scene.daemon.pid, signal.SIGKILL)
    scene.daemon.communicate()
    second.wait(15.0)
    assert not verify(scene.log).broken


def _gate_or_none(scene: Scene) -> psutil.Process | None:
    try:
        return gate_of(scene)
    except (StopIteration, psutil.NoSuchProcess):
        return None


def _sends(scene: Scene) -> bool:
    count = len(scene.sent)
    time.sleep(0.4)
    return len(scene.sent) > count
