"""One source of states, and one of commands: whoever speaks beside them trips the gate, and is named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bridges.zenoh.client import ask
from bridges.zenoh.session import open_client
from tests.processes.test_command import NS, Scene
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample


@pytest.fixture
def moving(twin: Any, tmp_path: Path, state_dir: Path, until: Any) -> Iterator[Scene]:
    """A hand on its way, armed by somebody who stays."""
    made = Scene(twin, tmp_path, state_dir)
    until(lambda: made.measured, 30.0)
    commander = made.armed(until)
    made.move = lambda: commander.ask("move", targets={"rh_FFJ3": 1.4}, seconds=100.0)  # type: ignore[attr-defined]
    made.rearm = lambda: commander.ask("arm", reason="again")  # type: ignore[attr-defined]
    made.beat = lambda: commander.ask("beat")  # type: ignore[attr-defined]
    yield made
    made.close()


def ended(scene: Any, until: Any, act: Any) -> str:
    """Why the gate ends a motion while `act` is done again and again."""
    sent = len(scene.sent)
    # what the last act has left in the last tenth of a second may refuse a motion that begins at once
    until(lambda: scene.rearm()["accepted"] and scene.move()["accepted"], 20.0)
    until(lambda: scene.beat() and len(scene.sent) > sent + 80)  # longer than others have to notice that it drives

    def over() -> Any:
        act()
        status = scene.beat()["gate"]
        return status["mode"] == "read_only" and status["ended"]

    return until(over, 20.0)


@pytest.mark.slow
def test_whoever_speaks_beside_hand_or_gate_ends_the_motion_and_is_named(moving: Any, until: Any) -> None:
    other = open_client(moving.twin.endpoint, 60.0)
    assert other is not None
    with other:
        # its stamps are ahead of the hand's, and it would be somewhere else
        names = tuple(moving.measured)

        def second_state() -> None:
            clock = moving.sent[-1].stamp_ns + 300_000_000
            other.put(f"{NS}/joint_states", cdr.encode(JointSample(clock, names, np.full(len(names), 1.3))))

        assert "second source of joint states" in ended(moving, until, second_state)
        assert moving.rearm()["check"] == "doubt"

        def said() -> list[Any]:  # the gate tells the daemon in its own time
            return [one for one in ask(other, f"twin/{NS}/events")["events"] if one["kind"] == "second_source"]

        told = until(said, 20.0)
        assert len(told) == 1
        assert "tcp/127.0.0.1" in told[0]["text"]  # the hand's own address
        assert abs(ask(other, f"twin/{NS}/state")["joints"]["rh_MFJ3"]["measured_rad"]) < 0.2

        publisher = other.declare_publisher(f"{NS}/joint_commands")

        def copied_stamp() -> None:
            last = moving.sent[-1]
            publisher.put(cdr.encode(replace(last, position=last.position + 0.2)))

        assert "somebody else" in ended(moving, until, copied_stamp)
        # the same bytes once more, from somebody else
        assert "somebody else" in ended(moving, until, lambda: publisher.put(cdr.encode(moving.sent[-1])))
        publisher.undeclare()
        # a second driver that is started by mistake says who it is
        started: list[Any] = []

        def second_driver() -> None:
            if not started:
                started.append(moving.twin.start("hand", "--trajectory", "none"))

        assert "second source of joint states: tcp/127.0.0.1" in ended(moving, until, second_driver)
