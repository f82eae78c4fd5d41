"""ROS nodes of tests, each in a process of its own."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.processes.conftest import until

HAS_ROS = importlib.util.find_spec("rclpy") is not None
needs_ros = [
    pytest.mark.ros,
    pytest.mark.skipif(not HAS_ROS, reason="ROS 2 is not installed here: make setup-ros"),
]


class Peer:
    """A ROS node in another process (ros_peer.py)."""

    def __init__(self, *ros_args: str) -> None:
        script = str(Path(__file__).with_name("ros_peer.py"))
        self.process = subprocess.Popen(
            [sys.executable, script, "--ros-args", *ros_args],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def ready(self) -> Peer:
        assert self._read() == "ready"
        return self

    def _read(self) -> Any:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def begin(self, does: str, **how: Any) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps({"do": does, **how}) + "\n")
        self.process.stdin.flush()

    def end(self) -> Any:
        return self._read()

    def do(self, does: str, **how: Any) -> Any:
        self.begin(does, **how)
        return self.end()

    def close(self) -> None:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        try:
            self.process.wait(5.0)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.process.stdout.close()


def latest(operator: Peer, timeout_s: float, level: int) -> dict[str, Any]:
    """The first diagnostics in which the daemon has this level."""

    def found() -> Any:
        heard = operator.do("take")["diagnostics"]
        return next((one for one in heard if one["daemon"]["level"] == level), None)

    return until(found, timeout_s)
