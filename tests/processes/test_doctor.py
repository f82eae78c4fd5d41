"""What the doctor says is what is so."""

from __future__ import annotations

import json
import socket
from typing import Any

import twin_daemon


def findings(twin: Any, code_expected: int) -> dict[str, Any]:
    code, out, err = twin.run("doctor", "--json", "-")
    assert code == code_expected, err
    report = json.loads(out)
    assert report["healthy"] is (code_expected == 0)
    return {finding["what"]: finding for finding in report["findings"]}


def test_a_machine_that_runs_these_tests_is_healthy(twin: Any) -> None:
    found = findings(twin, 0)
    assert found["mujoco"]["level"] == "ok"
    assert found["twin_daemon"]["found"] == twin_daemon.__version__
    assert found["clock"]["level"] in ("ok", "note")
    assert "24 joints" in found["hand"]["found"]
    assert "free" in found["endpoint"]["found"]
    assert found["ROS 2"]["level"] in ("ok", "note")


def test_an_address_that_cannot_be_used_is_a_problem(twin: Any) -> None:
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", int(twin.endpoint.rpartition(":")[2])))
        assert findings(twin, 1)["endpoint"]["level"] == "problem"
