"""The live path in real processes: whoever starts first, they find each other, answer, and end cleanly."""

from __future__ import annotations

import socket
import time
from typing import Any

import numpy as np
import pytest
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.session import open_client, session_config
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample

NS = "shadow_hand"


def names_of(session: zenoh.Session) -> tuple[str, ...]:
    return tuple(ask(session, f"twin/{NS}/state", 60.0)["joints"])


def test_with_nobody_there_a_question_ends_with_5(twin: Any) -> None:
    code, out, err = twin.run("query", "state", "--timeout", "0.5")
    assert code == 5
    assert out == ""
    assert len(err.strip().splitlines()) == 1
    assert "twin run" in err


def test_hand_first_then_daemon_and_the_reader_before_both(twin: Any) -> None:
    reader = twin.start("query", "state", "--timeout", "30", "--json", "-")
    hand = twin.start("hand", "--trajectory", "hand_closing", "--hidden", "backlash:rh_FFJ3=0.05")
    daemon = twin.start("run")
    assert twin.finish(reader)[0] == 0

    session = open_client(twin.endpoint, 10.0)
    assert session is not None
    predicted: list[JointSample] = []
    with session:
        key = f"twin/{NS}/joint_states"
        watching = session.declare_subscriber(key, lambda s: predicted.append(cdr.decode(s.payload.to_bytes())))
        alive = [str(reply.ok.key_expr) for reply in session.liveliness().get(f"twin/{NS}/alive") if reply.ok]
        assert alive == [f"twin/{NS}/alive"]
        state: dict[str, Any] = {}
        for _ in range(300):
            state = ask(session, f"twin/{NS}/state")
            if state["status"] == "following" and state["fresh_joints"] == 24 and len(predicted) > 50:
                break
            time.sleep(0.05)
        watching.undeclare()
    assert state["status"] == "following"
    assert len(state["joints"]) == 24
    assert all(not joint["stale"] and joint["age_s"] < 0.5 for joint in state["joints"].values())
    assert all(joint["predicted_rad"] is not None for joint in state["joints"].values())
    stamps = [sample.stamp_ns for sample in predicted]
    assert stamps == sorted(set(stamps))
    assert len(predicted[-1].names) == 24
    assert np.isfinite(predicted[-1].position).all()

    for process, word in ((hand, "stopped"), (daemon, "stopped")):
        code, _, err = twin.end(process)
        assert code == 0
        assert word in err.splitlines()[-1]


def test_what_is_broken_is_counted_and_the_daemon_goes_on(twin: Any, until: Any) -> None:
    daemon = twin.start("run")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        names = names_of(session)
        good = JointSample(0, names, np.zeros(24))
        bad = {
            "malformed": b"\x00\x01\x00\x00garbage that is no joint state",
            "too_large": b"\x00" * 400_000,
            "length_mismatch": cdr.encode(JointSample(0, names, np.zeros(3))),
            "not_finite": cdr.encode(JointSample(0, names, np.full(24, np.nan))),
            "unknown_names": cdr.encode(JointSample(0, ("gripper",), np.zeros(1))),
            "duplicate_names": cdr.encode(JointSample(0, ("rh_FFJ1", "rh_FFJ1"), np.zeros(2))),
            "empty": cdr.encode(JointSample(0, (), np.zeros(0))),
        }
        truncated = cdr.encode(good)[:-9]
        streams = ("joint_states", "joint_commands")

        def are_heard() -> bool:
            # a client that has just connected may not have been told of the daemon's subscriptions yet
            for stream in streams:
                session.put(f"{NS}/{stream}", bad["empty"])
            health = ask(session, f"twin/{NS}/health")
            return all(health[stream]["received"] > 0 for stream in streams)

        until(are_heard)
        for stream in streams:
            for payload in (*bad.values(), truncated):
                # waits for room: on a busy machine Zenoh drops what does not fit
                session.put(f"{NS}/{stream}", payload, congestion_control=zenoh.CongestionControl.BLOCK)

        def all_arrived() -> dict[str, Any] | None:
            health = ask(session, f"twin/{NS}/health")
            counts = [health[stream]["counts"] for stream in streams]
            done = all(set(bad) <= set(count) and count["malformed"] == 2 for count in counts)
            return health if done else None

        health = until(all_arrived)
        assert set(bad) <= set(health["joint_states"]["counts"])
        assert health["joint_states"]["counts"]["malformed"] == 2
        assert health["joint_states"]["accepted"] == 0
        assert set(bad) <= set(health["joint_commands"]["counts"])
        assert health["loop"]["errors"] == 0
        assert ask(session, f"twin/{NS}/state")["status"] == "waiting"

        def follows() -> bool:
            session.put(f"{NS}/joint_states", cdr.encode(good))
            return ask(session, f"twin/{NS}/state")["fresh_joints"] == 24

        until(follows)
    assert daemon.poll() is None
    assert twin.end(daemon)[0] == 0


@pytest.mark.slow
def test_a_second_daemon_for_the_same_hand_says_so(twin: Any) -> None:
    daemon = twin.start("run")
    assert twin.query("version")["id"] == "nominal"
    code, _, err = twin.run("run", "--seconds", "5")
    assert code == 3
    assert "served there already" in err.splitlines()[-1]
    other = twin.start("run", "--namespace", "left", "--seconds", "20")
    code, _, err = twin.run("query", "state", "--namespace", "left", "--timeout", "15", "--json", "-")
    assert code == 0, err
    assert twin.end(other)[0] == 0
    assert twin.end(daemon)[0] == 0


def test_an_address_in_use_by_something_else_is_named(twin: Any) -> None:
    with socket.socket() as squatter:
        squatter.bind(("127.0.0.1", int(twin.endpoint.rpartition(":")[2])))
        squatter.listen()
        code, _, err = twin.run("run", "--seconds", "5")
    assert code == 3
    assert "not Zenoh" in err.splitlines()[-1]


def test_a_router_that_is_there_already_is_joined(twin: Any) -> None:
    with zenoh.open(session_config("router", listen=[twin.endpoint])) as router:
        daemon = twin.start("run")
        assert len(names_of(router)) == 24
        assert twin.end(daemon)[0] == 0


def test_a_wrong_configuration_is_refused_with_the_nearest_key(twin: Any, tmp_path: Any) -> None:
    (tmp_path / "twin.yaml").write_text("endpont: tcp/127.0.0.1:1\n")
    code, _, err = twin.run("run", "-c", "twin.yaml")
    assert code == 3
    assert "Did you mean 'endpoint'?" in err
