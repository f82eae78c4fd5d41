"""`twin record` beside a running hand and its twin: whole files, or files that say that they are not."""

from __future__ import annotations

import json
import os
import pty
import signal
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import zenoh
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from websockets import Subprotocol
from websockets.sync.client import connect

from bridges.zenoh.client import ask
from bridges.zenoh.session import open_client
from tests.processes.conftest import Twin, until
from twin_daemon.cli.app import main
from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.recordings import load_recording
from twin_daemon.resources import twin_command

NS = "shadow_hand"
RATE_HZ = 125
TOPICS = ("joint_states", "joint_commands", "twin/joint_states", "twin/residual")


class Live(NamedTuple):
    twin: Twin
    folder: Path


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    """A moving hand and a daemon that follows it."""
    folder = tmp_path_factory.mktemp("live")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TWIN_STATE_DIR", str(folder / "state"))
        twin = Twin(folder)
    with twin:
        daemon, hand = twin.start("run"), twin.start("hand", "--trajectory", "hand_closing")
        with connected(twin) as session:
            until(lambda: ask(session, f"twin/{NS}/state", 60.0)["status"] == "following")
        yield Live(twin, folder)
        for process in (hand, daemon):
            code, _, err = twin.end(process)
            assert code == 0, err


def connected(twin: Twin) -> zenoh.Session:
    session = open_client(twin.endpoint, 60.0)
    assert session is not None
    return session


def stamps_and_values(path: Path) -> dict[str, dict[int, tuple[np.ndarray, int]]]:
    """By topic and stamp: position by sorted names, time of arrival."""
    found: dict[str, dict[int, tuple[np.ndarray, int]]] = {topic: {} for topic in TOPICS}
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
        for connection, received_ns, raw in reader.messages():
            message: Any = reader.deserialize(raw, connection.msgtype)
            stamp_ns = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
            order = np.argsort(message.name)
            found[connection.topic[1:]][stamp_ns] = np.array(message.position)[order], received_ns
    return found


def test_three_seconds_of_everything_then_the_last_minutes(live: Live) -> None:
    twin, folder = live
    code, out, err = twin.run("record", "-o", "r.mcap", "--seconds", "3", "--json", "-")
    assert code == 0, err
    assert err == "", "no progress line where nobody watches"
    told = json.loads(out)
    path = folder / "r.mcap"
    assert list(folder.glob("r.mcap*")) == [path]
    assert path.stat().st_size == told["bytes"]
    assert (told["refused"], told["dropped"]) == (0, 0)

    recording = load_recording(path)
    assert recording.quality.messages == told["topics"]["joint_states"]["messages"]
    assert recording.quality.dropped == {}
    assert 0.5 * 3 * RATE_HZ < recording.quality.messages < 1.5 * 3 * RATE_HZ
    assert recording.commands is not None
    assert len(recording.joints) == 24

    read = stamps_and_values(path)
    assert {topic: len(values) for topic, values in read.items()} == {
        topic: about["messages"] for topic, about in told["topics"].items()
    }
    # what is called residual is measured minus predicted, for the same stamp
    both = read["joint_states"].keys() & read["twin/joint_states"].keys() & read["twin/residual"].keys()
    assert len(both) > 50
    known = 0
    for stamp_ns in both:
        residual, arrived_ns = read["twin/residual"][stamp_ns]
        left = read["joint_states"][stamp_ns][0] - read["twin/joint_states"][stamp_ns][0]
        finite = np.isfinite(residual)
        known += int(finite.sum())
        np.testing.assert_allclose(residual[finite], left[finite], atol=1e-9)
        assert abs(arrived_ns - stamp_ns) < 2 * 10**9
    assert known > 1000

    code, out, err = twin.run("record", "--keep")
    assert code == 0, err
    kept = Path(out.strip())
    assert kept.parent == folder / "state" / "recordings"
    assert kept.name.startswith("kept-")
    assert list(kept.parent.iterdir()) == [kept]
    # the daemon has heard all that the recorder has, and more
    held = stamps_and_values(kept)
    assert all(held[topic].keys() >= read[topic].keys() for topic in TOPICS)
    assert set(recording.stamp_ns.tolist()) <= set(load_recording(kept).stamp_ns.tolist())
    with connected(twin) as session:
        health = ask(session, f"twin/{NS}/health")
    assert (health["loop"]["errors"], health["loop"]["dropped"]) == (0, 0)


def test_an_interrupt_completes_the_file_and_a_kill_leaves_what_can_be_recovered(
    live: Live, capfd: pytest.CaptureFixture[str]
) -> None:
    twin, folder = live
    interrupted, killed = twin.start("record"), twin.start("record", "-o", "killed.mcap")
    part, path = folder / "killed.mcap.part", folder / "killed.mcap"
    until(lambda: part.exists() and part.stat().st_size > 500_000)
    assert main(["record", "-o", str(path), "--seconds", "1"]) == 3
    assert "is being written" in capfd.readouterr().err
    killed.send_signal(signal.SIGKILL)
    twin.finish(killed)
    assert not path.exists()
    with pytest.raises(BadInput, match="twin record --recover"):
        load_recording(part)
    assert main(["record", "--recover", str(part)]) == 0
    assert load_recording(folder / "killed-recovered.mcap").quality.messages > 0.5 * RATE_HZ

    interrupted.send_signal(signal.SIGINT)
    code, out, err = twin.finish(interrupted)
    assert code == 0, err
    assert "twin/residual" in out
    (path,) = folder.glob("shadow_hand-*Z.mcap")
    assert path.name in out
    assert load_recording(path).quality.messages > RATE_HZ


def test_a_terminal_sees_the_counts_of_each_topic(live: Live) -> None:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TWIN_ENDPOINT": live.twin.endpoint, "TERM": "xterm", "COLUMNS": "200"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    process = subprocess.Popen(
        twin_command("record", "-o", "seen.mcap", "--seconds", "2.5"),
        cwd=live.folder, env=environment, stdout=subprocess.DEVNULL, stderr=theirs,
    )  # fmt: skip
    os.close(theirs)
    seen = b""
    try:
        while chunk := os.read(ours, 4096):
            seen += chunk
    except OSError:  # the terminal's other end is closed
        pass
    finally:
        os.close(ours)
    assert process.wait(20.0) == 0
    assert b"joint_states " in seen
    assert b"dropped 0" in seen


def test_what_makes_no_sense_is_refused(
    twin: Twin, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "r.mcap").write_text("precious")
    assert main(["record", "-o", "r.mcap", "--seconds", "1"]) == 3
    assert "exists already" in capfd.readouterr().err
    assert (tmp_path / "r.mcap").read_text() == "precious"
    for wrong in (["-o", "r.bag"], ["--keep", "--seconds", "1"], ["--recover", "r.mcap", "--seconds", "1"]):
        assert main(["record", *wrong]) == 2
    assert main(["record", "--seconds", "0.3", "--endpoint", twin.endpoint]) == 5
    assert "nothing listens" in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["r.mcap"]


@pytest.mark.slow
def test_with_nothing_to_keep_and_with_no_room_for_it_nothing_is_written(
    twin: Twin, tmp_path: Path, state_dir: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    recordings = state_dir / "recordings"
    recordings.mkdir(parents=True)
    (recordings / "mine.mcap").write_bytes(bytes(2**20))
    (tmp_path / "twin.yaml").write_text("daemon:\n  recordings_quota_mib: 1\n")
    daemon = twin.start("run", "-c", "twin.yaml")
    keep = ["record", "--keep", "--endpoint", twin.endpoint]
    with connected(twin) as session:
        ask(session, f"twin/{NS}/version", 60.0)
        assert main(["record", "-o", str(tmp_path / "r.mcap"), "--seconds", "0.5", "--endpoint", twin.endpoint]) == 5
        assert "nothing arrived" in capfd.readouterr().err
        assert main(keep) == 5
        assert "nothing has arrived" in capfd.readouterr().err

        hand = twin.start("hand")
        until(lambda: ask(session, f"twin/{NS}/health")["joint_states"]["accepted"] > 10)
        assert main(keep) == 3
        out, err = capfd.readouterr()
        assert "recordings_quota_mib" in err
        assert (out, len(err.splitlines())) == ("", 1)
        # to look at everything below the namespace is no wish to keep
        replies = [reply.ok for reply in session.get(f"twin/{NS}/*", timeout=5.0) if reply.ok is not None]
        (kept,) = [json.loads(ok.payload.to_bytes()) for ok in replies if str(ok.key_expr) == f"twin/{NS}/keep"]
        assert not kept["kept"]
        assert "wildcard" in kept["why"]
    assert [path.name for path in recordings.iterdir()] == ["mine.mcap"]
    assert list(tmp_path.glob("*.mcap*")) == []
    for process in (hand, daemon):
        code, _, err = twin.end(process)
        assert code == 0, err


@pytest.mark.slow
def test_foxglove_sees_the_live_hand(live: Live) -> None:
    pytest.importorskip("foxglove", reason="the extra 'foxglove' is not installed")
    bridge = live.twin.start("bridge", "foxglove", "--port", "0")
    assert bridge.stderr is not None
    line = next(text for text in bridge.stderr if "ws://" in text)
    threading.Thread(target=bridge.stderr.read, daemon=True).start()
    wanted = {"/joint_states", "/joint_commands", "/twin/joint_states", "/twin/residual", "/twin/health", "/twin/model"}
    with connect(line.split()[-1], subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as socket:
        channels: dict[int, dict[str, Any]] = {}
        while not wanted <= {one["topic"] for one in channels.values()}:
            told = socket.recv(timeout=30.0)
            if isinstance(told, str) and (found := json.loads(told))["op"] == "advertise":
                channels |= {one["id"]: one for one in found["channels"]}
        asked = [{"id": number, "channelId": number} for number in channels]
        socket.send(json.dumps({"op": "subscribe", "subscriptions": asked}))
        heard: dict[str, bytes] = {}
        while not wanted <= set(heard):
            told = socket.recv(timeout=30.0)
            if isinstance(told, bytes) and told[0] == 1:  # data of a message: subscription, time, what was said
                heard[channels[struct.unpack_from("<I", told, 1)[0]]["topic"]] = told[13:]
    store = get_typestore(Stores.ROS2_JAZZY)
    names = set(load_hand().joints)
    for topic in ("/joint_states", "/twin/joint_states", "/twin/residual"):
        message: Any = store.deserialize_cdr(heard[topic], "sensor_msgs/msg/JointState")
        assert set(message.name) == names, topic
        assert len(message.position) == len(names)
    assert json.loads(heard["/twin/health"])["status"]
    assert "<mujoco" in json.loads(heard["/twin/model"])["mjcf"]
    bridge.send_signal(signal.SIGTERM)
    assert bridge.wait(20) == 0
