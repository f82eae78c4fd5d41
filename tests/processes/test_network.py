"""The daemon among others: a ROS 2 system's keys, monitoring, two hands in one network, a restarted router."""

from __future__ import annotations

import json
import time
import urllib.request
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.ros_keys import RosKeys, type_hash
from bridges.zenoh.session import open_client, open_daemon, session_config
from tests.processes.conftest import free_port
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.daemon.settings import RosSettings
from twin_daemon.errors import BadInput, NoAnswer

# As rmw_zenoh and `ros2 topic info --verbose` on Jazzy print it.
JOINT_STATE = "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e"


def test_the_keys_are_those_of_a_ros_2_system() -> None:
    assert type_hash("sensor_msgs/msg/JointState") == JOINT_STATE
    bridged = RosKeys(RosSettings(transport="ros2dds", joint_states="/hand/joint_states"))
    assert bridged.subscribed["joint_states"] == "hand/joint_states"
    assert bridged.attachment() is None
    native = RosKeys(RosSettings(transport="rmw_zenoh", domain=7))
    assert native.published == f"7/twin/joint_states/sensor_msgs::msg::dds_::JointState_/{JOINT_STATE}"
    sent = f"7/joint_states/sensor_msgs::msg::dds_::JointState_/{JOINT_STATE}"
    assert zenoh.KeyExpr(native.subscribed["joint_states"]).includes(zenoh.KeyExpr(sent))


@pytest.mark.parametrize("transport", ["ros2dds", "rmw_zenoh"])
def test_a_ros_2_system_is_reached_without_ros(transport: str, twin: Any, tmp_path: Path, until: Any) -> None:
    (tmp_path / "twin.yaml").write_text(f"ros: {{transport: {transport}, domain: 3}}\n")
    daemon = twin.start("run", "-c", "twin.yaml")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    middle = {"ros2dds": ("", ""), "rmw_zenoh": ("3/", f"/sensor_msgs::msg::dds_::JointState_/{JOINT_STATE}")}
    before, after = middle[transport]
    heard: list[zenoh.Sample] = []
    with session:
        names = tuple(ask(session, "twin/shadow_hand/state", 60.0)["joints"])
        session.declare_subscriber(f"{before}twin/joint_states{after}", heard.append)

        def sent_and_heard() -> bool:
            sample = JointSample(time.time_ns(), names, np.zeros(24))
            session.put(f"{before}joint_states{after}", cdr.encode(sample), attachment=b"\x01whatever")
            return len(heard) > 5

        until(sent_and_heard)
    assert len(cdr.decode(heard[-1].payload.to_bytes()).names) == 24
    if transport == "rmw_zenoh":
        attachments = [sample.attachment.to_bytes() for sample in heard if sample.attachment]
        assert all(b"sequence_number" in a and b"source_gid" in a for a in attachments)
        assert len({a[-16:] for a in attachments}) == 1
    assert twin.end(daemon)[0] == 0


def test_monitoring_reads_what_health_says(twin: Any, tmp_path: Path, until: Any) -> None:
    port = free_port()
    (tmp_path / "twin.yaml").write_text(f"daemon: {{metrics_port: {port}}}\n")
    daemon, hand = twin.start("run", "-c", "twin.yaml"), twin.start("hand")

    def scraped() -> dict[str, float]:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5.0) as answer:
            lines = answer.read().decode().splitlines()
        return {name: float(value) for name, _, value in (x.rpartition(" ") for x in lines if not x.startswith("#"))}

    def flowing() -> dict[str, float] | None:
        try:
            found = scraped()
        except OSError:
            return None
        ready = found.get('twin_messages_total{hand="shadow_hand",stream="joint_states"}', 0.0) > 150
        return found if ready else None

    found = until(flowing)
    assert found['twin_stale{hand="shadow_hand"}'] == 0.0
    assert found['twin_rate_hertz{hand="shadow_hand"}'] == pytest.approx(125.0, rel=0.05)
    assert found['twin_residual_rmse_radians{hand="shadow_hand",joint="rh_FFJ3"}'] >= 0.0
    assert [twin.end(process)[0] for process in (hand, daemon)] == [0, 0]


@pytest.mark.slow
def test_two_hands_in_one_network_do_not_hear_each_other(twin: Any, until: Any) -> None:
    daemons = [twin.start("run", "--namespace", name) for name in ("left", "right")]
    hand = twin.start("hand", "--namespace", "right")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        until(lambda: ask(session, "twin/right/state", 60.0)["fresh_joints"] == 24)
        left = ask(session, "twin/left/health", 60.0)
    assert left["joint_states"]["received"] == 0
    assert [twin.end(process)[0] for process in (hand, *daemons)] == [0, 0, 0]


def test_a_router_on_another_machine_that_is_not_there_is_missed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bridges.zenoh.session._ROUTER_S", 0.1)
    elsewhere = "tcp/192.0.2.1:7447"  # kept for documentation: nobody has this address (RFC 5737)
    with pytest.raises(NoAnswer, match="another machine's address"):
        open_daemon(elsewhere)
    with pytest.raises(BadInput, match="rules of another"):
        open_daemon(elsewhere, access={})


def test_streaming_goes_on_after_the_router_was_killed(twin: Any, until: Any) -> None:
    def router() -> zenoh.Session:
        return zenoh.open(session_config("router", listen=[twin.endpoint]))

    meeting_point = router()
    daemon, hand = twin.start("run"), twin.start("hand")
    reader = open_client(twin.endpoint, 60.0)
    assert reader is not None
    with reader:
        until(lambda: ask(reader, "twin/shadow_hand/health", 60.0)["timing"]["rate_hz"])
    meeting_point.close()
    time.sleep(1.0)
    meeting_point = router()
    begun_s = time.monotonic()
    reader = open_client(twin.endpoint, 60.0)
    assert reader is not None
    with meeting_point, reader:

        def again() -> dict[str, Any] | None:
            try:
                health = ask(reader, "twin/shadow_hand/health", 1.0)
            except Exception:
                return None
            # The gap is counted with the second message after it, and "stale" ends with the first.
            return health if not health["stale"] and health["timing"]["missing"] > 50 else None

        health = until(again)
        assert time.monotonic() - begun_s < 15.0
        kinds = [event["kind"] for event in ask(reader, "twin/shadow_hand/events", 5.0)["events"]]
        assert "stale" in kinds
        assert json.dumps(health, allow_nan=False)
        assert [twin.end(process)[0] for process in (hand, daemon)] == [0, 0]


@pytest.mark.slow
def test_a_diagnosis_of_the_last_minutes_runs_beside_the_loop(twin: Any, until: Any) -> None:
    daemon, hand = twin.start("run"), twin.start("hand", "--trajectory", "none")
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    with session:
        refused = ask(session, "twin/shadow_hand/diagnosis", 60.0)
        assert (refused["running"], refused["result"]) == (False, None)
        until(lambda: ask(session, "twin/shadow_hand/health", 60.0)["joint_states"]["accepted"] > 100)
        still = JointSample(time.time_ns(), ("rh_FFJ3",), np.zeros(1))
        session.put("shadow_hand/joint_commands", cdr.encode(still))
        until(lambda: ask(session, "twin/shadow_hand/health", 60.0)["joint_states"]["accepted"] > 900)
        started = ask(session, "twin/shadow_hand/diagnose", 60.0)
        assert started["accepted"], started
        assert ask(session, "twin/shadow_hand/diagnose", 60.0)["accepted"] is False

        def ended() -> dict[str, Any] | None:
            answer = ask(session, "twin/shadow_hand/diagnosis", 60.0)
            return None if answer["running"] else answer

        answer = until(ended, 60.0)
        # nobody moved the hand: an honest diagnosis says so
        assert answer["result"].get("verdict") == "not_excited", answer["result"]
        assert Path(answer["recording"]).is_file()
        events = ask(session, "twin/shadow_hand/events", 5.0)["events"]
        assert events[-1]["kind"] == "diagnosis"
    assert [twin.end(process)[0] for process in (hand, daemon)] == [0, 0]
