"""Somebody on the machine means harm: a flood and hostile questions are refused and counted, and the twin lives on."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import Any

import psutil
import pytest
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client
from twin_daemon.hand import load_hand

NS = "shadow_hand"
MIB = 2**20
FLOOD = """
import itertools, sys, threading
from bridges.zenoh.session import open_client
endpoint, keys = sys.argv[1], sys.argv[2:]
payloads = itertools.cycle([b"", b"\\x00\\x01\\x00\\x00" + b"x" * 1500, b"[" * 3000, bytes(300_000)])
session = open_client(endpoint, 10.0)
threading.Thread(target=lambda: (sys.stdin.read(), stop.set())).start()
stop, sent = threading.Event(), 0
while not stop.is_set():
    for key in keys:
        session.put(key, next(payloads), attachment=b'{"who": "operator", "code": "0"}')
        sent += 1
session.close()
print(sent)
"""


@pytest.fixture
def followed(twin: Any, until: Any) -> psutil.Process:
    """A daemon that follows its hand."""
    twin.start("hand", "--trajectory", "hand_closing")
    daemon = twin.start("run")
    until(lambda: twin.query("state")["status"] == "following", 30.0)
    return psutil.Process(daemon.pid)


def test_a_flood_is_counted_and_stops_neither_loop_nor_gate(twin: Any, followed: psutil.Process, until: Any) -> None:
    before = followed.memory_info().rss
    keys = [f"{NS}/joint_states", f"{NS}/joint_commands", f"twin/{NS}/command/target"]
    flood = subprocess.Popen(
        [sys.executable, "-c", FLOOD, twin.endpoint, *keys],
        env=twin._environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    session = open_client(twin.endpoint, 10.0)
    assert session is not None
    with session:
        try:

            def flooded() -> bool:
                health = ask(session, f"twin/{NS}/health", 60.0)
                return health["joint_states"]["counts"].get("malformed", 0) > 500

            until(flooded, 40.0)
            # in the midst of it, somebody has to be able to stop the hand
            assert Commander(session, load_hand().description).ask("stop", 10.0, reason="a flood")["accepted"]
        finally:
            sent, _ = flood.communicate("", timeout=20.0)
        assert int(sent) > 2000
        until(lambda: ask(session, f"twin/{NS}/state", 60.0)["status"] == "following", 20.0)
        health = ask(session, f"twin/{NS}/health")
        assert health["loop"]["errors"] == 0
        assert health["joint_states"]["counts"]["too_large"] > 0
        gate = ask(session, f"twin/{NS}/command/status")
        assert gate["mode"] == "stopped"
        assert gate["errors"] == 0
    assert followed.memory_info().rss < before + 200 * MIB
    entries = twin.run("audit", "show", "--json", "-")[1]
    assert len(entries) < MIB  # of refusals that repeat, one a second is written


def answers(session: zenoh.Session, selector: str, **more: Any) -> list[str]:
    """What was answered in 5 s, errors too."""
    replies = session.get(selector, timeout=5.0, **more)
    return [(reply.ok or reply.err).payload.to_string() for reply in replies]


def test_hostile_questions_get_an_error_or_nothing(
    twin: Any, followed: psutil.Process, state_dir: Path, until: Any
) -> None:
    (state_dir.parent / "secret.json").write_text('{"secret": "not to be told"}')
    session = open_client(twin.endpoint, 10.0)
    assert session is not None
    until(lambda: any(state_dir.rglob("keys.json")))
    before = {path for path in state_dir.rglob("*") if path.is_file()}
    with session:
        for reference in ("../../secret.json", "../../../keys.json", "a" * 20_000, "..", "%2e%2e", "' OR 1=1 --"):
            (answer,) = answers(session, f"twin/{NS}/versions/{reference}")
            assert "there is nothing at" in answer
        nested, large, proof = b"[" * 10**6, b"0" * 8 * MIB, b'{"who": "' + b"x" * MIB + b'", "code": "0"}'
        for payload in (nested, large, b"\xff\xfe", b"null", b'{"targets": {"rh_FFJ3": 1e999}}'):
            for verb in ("move", "trajectory", "arm", "recalibrate", "status"):
                (answer,) = answers(session, f"twin/{NS}/command/{verb}", payload=payload, attachment=proof)
                assert verb == "status" or '"accepted": false' in answer
        for selector in ("**", "twin/**", f"twin/{NS}/*", f"twin/{NS}/state?{'x=1;' * 10_000}", f"twin/{NS}/command/*"):
            assert not [answer for answer in answers(session, selector) if '"accepted": true' in answer]
        # to look at everything began no diagnosis: the gate is the only child
        assert ["gate" in child.cmdline() for child in followed.children()] == [True]
        assert ask(session, f"twin/{NS}/diagnosis")["running"] is False
        health = ask(session, f"twin/{NS}/health")
        assert health["loop"]["errors"] == 0
        assert ask(session, f"twin/{NS}/command/status")["errors"] == 0
        assert ask(session, f"twin/{NS}/state")["status"] == "following"
    new = {path.name for path in state_dir.rglob("*") if path.is_file()} - {path.name for path in before}
    assert not new
