"""The server without a browser: who may do what, what it says live, and that it says every error."""

from __future__ import annotations

import json
import socket
from typing import Any

import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.processes.conftest import Twin, until


def test_reading_is_free_and_everything_else_needs_the_token(served: Any) -> None:
    assert served.ask("/")[0] == 200
    for path in ("/api/keep", "/api/anything"):
        status, answer = served.ask(path, {}, token=False)
        assert (status, "token" in answer["error"] or "whole address" in answer["error"]) == (401, True)
        assert served.ask(path, {}, token=False, X_Twin_Token=served.token[:-1])[0] == 401
    assert served.ask("/api/keep", {})[0] == 503  # allowed, but no daemon is there
    assert served.token not in served.ask("/")[1]


def test_a_foreign_name_or_page_gets_nothing(served: Any) -> None:
    assert served.ask("/", Host="twin.lab")[0] == 200
    for headers in (
        {"Host": "evil.example"},
        {"Host": f"evil.example:{served.host.rpartition(':')[2]}"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Sec_Fetch_Site": "cross-site", "Sec_Fetch_Mode": "no-cors"},
    ):
        for path, body in (("/", None), ("/api/keep", {}), ("/api/stop", {})):
            status, answer = served.ask(path, body, **headers)
            assert status == 403, headers
            assert set(answer) == {"error"}
    for origin in ("http://evil.example", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            connect(f"ws://{served.host}/live", origin=origin)


def test_the_policy_forbids_foreign_code(served: Any) -> None:
    with socket.create_connection(served.host.split(":")) as raw:
        raw.sendall(f"GET / HTTP/1.0\r\nHost: {served.host}\r\n\r\n".encode())
        head = raw.makefile("rb").read().partition(b"\r\n\r\n")[0].decode().lower()
    policy = next(line for line in head.splitlines() if line.startswith("content-security-policy"))
    assert "default-src 'none'" in policy
    assert "script-src 'self';" in policy
    assert "frame-ancestors 'none'" in policy
    assert "x-content-type-options: nosniff" in head
    assert served.ask("/static/../app.py")[0] == 404
    assert served.ask("/static/%2e%2e/app.py")[0] == 404


def test_what_cannot_be_is_one_line(served: Any, processes: Twin) -> None:
    assert served.ask("/nothing")[1] == {"error": "Not Found."}
    for body in (["no object"], {"reason": "x" * 70_000}):
        status, answer = served.ask("/api/keep", body)
        assert status == 400, answer
        assert "request" in answer["error"]
    status, answer = served.ask("/api/stop", {}, token=False)
    assert status == 503
    assert "NOT stopped" in answer["error"]
    code, _, err = processes.run("workbench", "--port", served.host.rpartition(":")[2])
    assert code == 3
    assert "--port" in err


def test_the_stream_tells_hand_and_twin_and_who_is_away(workbench: Any, processes: Twin) -> None:
    served = workbench()
    with connect(f"ws://{served.host}/live", max_size=None) as stream:

        def frame(wanted: Any) -> dict[str, Any]:
            return until(lambda: (found := json.loads(stream.recv(timeout=20))) and wanted(found) and found, 40.0)

        about = frame(lambda f: "about" in f)["about"]
        assert about["presence"] == "unreachable"
        assert "twin run" in about["words"]
        daemon = processes.start("run")
        processes.start("hand", "--trajectory", "rich_finger")
        frame(lambda f: f.get("about", {}).get("presence") == "following")
        first, second = (frame(lambda f: len(f.get("t", ())) > 0) for _ in range(2))
        assert not second["fresh"]
        assert first["t"][-1] < second["t"][0]
        assert second["t"] == sorted(second["t"])
        for part in ("measured", "predicted"):
            assert len(second[part]) == 24
            assert {len(values) for values in second[part]} == {len(second["t"])}
        known = frame(lambda f: "about" in f and f["about"]["version"])
        assert known["about"]["gate"] == "read_only"
        assert any(value > 0.0 for value in known["rms"] if value is not None)

        kept = until(lambda: (found := served.ask("/api/keep", {}))[0] == 200 and found[1]["kept"] and found[1], 40.0)
        assert kept["messages"] > 0
        status, answer = served.ask("/api/stop", {"reason": "a test"}, token=False)
        assert (status, answer["accepted"]) == (200, True)
        frame(lambda f: f.get("about", {}).get("gate") == "stopped")

        processes.end(daemon)
        assert "silent" in frame(lambda f: f.get("about", {}).get("presence") == "away")["about"]["words"]
        processes.start("run")
        frame(lambda f: f.get("about", {}).get("presence") == "following")
        frame(lambda f: len(f.get("t", ())) > 0)
