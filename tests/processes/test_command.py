"""Commands to a hand in real processes: through the gate or not at all, and at rest when anybody dies."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh

from bridges.zenoh.client import ask
from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client
from tests.processes.conftest import SLOW_MACHINE
from twin_daemon.cli.leases import keep_lease, lease_file
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.gate.audit import entries_of, verify
from twin_daemon.hand import load_hand
from twin_daemon.security.identity import Identity, Keyring, load_keyring

NS = "shadow_hand"
SLOW_HAND = SLOW_MACHINE | {"tracking_time_s": 0.5}


class Scene:
    """A daemon, a hand that waits for commands, and a session of somebody who watches."""

    def __init__(self, twin: Any, tmp_path: Path, state_dir: Path, *hand: str, **more: Any) -> None:
        config = tmp_path / "twin.yaml"
        config.write_text(yaml.safe_dump({"gate": SLOW_HAND} | more))
        self.twin = twin
        self.log = state_dir / "hands" / NS / "audit.jsonl"
        self.keys = state_dir / "keys.json"
        self.daemon = twin.start("run", "-c", str(config))
        self.hand = twin.start("hand", "--trajectory", "none", *hand)
        session = open_client(twin.endpoint, 60.0)
        assert session is not None
        self.session = session
        self.description = load_hand().description
        self.sent: list[JointSample] = []
        self.measured: dict[str, float] = {}
        self.effort: list[tuple[float, float]] = []  # of FFJ3, N m, with its time, s
        self._watching = [
            session.declare_subscriber(f"{NS}/joint_commands", self._command),
            session.declare_subscriber(f"{NS}/joint_states", self._state),
        ]

    def _command(self, sample: zenoh.Sample) -> None:
        self.sent.append(cdr.decode(sample.payload.to_bytes()))

    def _state(self, sample: zenoh.Sample) -> None:
        state = cdr.decode(sample.payload.to_bytes())
        self.measured = dict(zip(state.names, state.position.tolist(), strict=True))
        if len(state.effort):  # a second source has none
            self.effort.append((time.monotonic(), float(state.effort[state.names.index("rh_FFJ3")])))

    def commander(self, name: str = "operator") -> Commander:
        return Commander(self.session, self.description, load_keyring(self.keys), name)

    def heard(self) -> bool:
        """Whether the daemon hears the hand."""
        return ask(self.session, f"twin/{NS}/state")["fresh_joints"] == 24

    def armed(self, until: Any) -> Commander:
        """Somebody who has armed the hand, once the daemon hears it."""
        commander = self.commander()
        answers: list[dict[str, Any]] = []
        until(lambda: answers.append(commander.ask("arm", reason="a test")) or answers[-1]["accepted"], 20.0)
        keep_lease(lease_file(NS, "operator"), commander.lease)  # so that 'twin command' goes on with it
        return commander

    def close(self) -> None:
        for subscriber in self._watching:
            subscriber.undeclare()
        self.session.close()


@pytest.fixture
def scene(twin: Any, tmp_path: Path, state_dir: Path, until: Any) -> Iterator[Scene]:
    made = Scene(twin, tmp_path, state_dir)
    until(lambda: made.measured, 30.0)
    yield made
    made.close()


def test_armed_for_a_reason_the_hand_goes_where_it_is_sent(scene: Scene, until: Any) -> None:
    twin = scene.twin
    until(lambda: scene.heard(), 20.0)
    code, _, err = twin.run("command", "move", "rh_FFJ3=0.4")
    assert code == 4
    assert "arm first" in err
    assert len(err.strip().splitlines()) == 1
    assert twin.run("command", "arm", "--reason", "a test")[0] == 0
    code, out, err = twin.run("command", "move", "rh_FFJ3=0.4", "FFJ0=0.6", "--json", "-")
    assert code == 0, err
    assert json.loads(out)["gate"]["ended"] == "done"
    assert set(scene.sent[-1].names) == {"rh_FFJ0", "rh_FFJ3"}
    until(lambda: abs(scene.measured["rh_FFJ3"] - 0.4) < 0.1)
    sent = len(scene.sent)
    code, out, _ = twin.run("command", "trajectory", "hand_closing", "--dry-run", "--json", "-")
    assert code == 0
    assert json.loads(out)["rehearsal"]["duration_s"] > 5.0
    assert {tuple(one.position) for one in scene.sent[sent:]} <= {tuple(scene.sent[sent - 1].position)}
    assert twin.run("command", "disarm")[0] == 0
    code, out, _ = twin.run("audit", "show", "--json", "-")
    assert [entry["verb"] for entry in json.loads(out)["entries"]] == ["move", "arm", "move", "disarm"]
    assert twin.run("audit", "verify")[0] == 0


def test_denied_commanders_get_nothing_through_and_are_written_down(scene: Scene, until: Any) -> None:
    wrong = Keyring({"operator": Identity(role="operator", key="ab" * 32)})
    stranger = Keyring({"x": Identity(role="operator", key="cd" * 32)})
    denied = {
        "no credentials": Commander(scene.session, scene.description),
        "wrong ones": Commander(scene.session, scene.description, wrong, "operator"),
        "nobody known": Commander(scene.session, scene.description, stranger, "x"),
    }
    honest = scene.armed(until)
    for who, commander in denied.items():
        for verb, body in (("move", {"targets": {"rh_FFJ3": 0.5}}), ("disarm", {}), ("arm", {"reason": "mine"})):
            answer = commander.ask(verb, **body)
            assert not answer["accepted"], who
            assert answer["check"] in ("identity", "role")
        commander.stream(publisher := commander.stream_to(), {"rh_FFJ3": 0.1})
        publisher.undeclare()
    # a request that was overheard and comes again
    payload, proof = honest._signer.signed("move", {"targets": {"rh_FFJ3": 0.05}})
    first = honest._get("move", payload, proof, 10.0)
    again = honest._get("move", payload, proof, 10.0)
    assert first["accepted"]
    assert again["check"] == "order"
    # the same bytes for another verb
    assert honest._get("disarm", b"{}", proof, 5.0)["check"] == "identity"
    refused = [entry for entry in entries_of(scene.log) if not entry["accepted"]]
    assert {entry["check"] for entry in refused} >= {"identity", "role", "order"}
    until(lambda: scene.sent)
    assert max(abs(value) for one in scene.sent for value in one.position) <= 0.05 + 1e-6
    assert not verify(scene.log).broken


@pytest.mark.parametrize(
    ("victim", "signal_number"),
    [
        pytest.param("commander", signal.SIGKILL, id="commander-killed"),
        pytest.param("daemon", signal.SIGKILL, id="daemon-killed"),
        pytest.param("daemon", signal.SIGSTOP, id="daemon-stopped"),
        pytest.param("hand", signal.SIGKILL, id="hand-killed"),
        pytest.param("commander", signal.SIGSTOP, id="commander-stopped", marks=pytest.mark.slow),
        pytest.param("hand", signal.SIGSTOP, id="hand-stopped", marks=pytest.mark.slow),
    ],
)
def test_whoever_dies_the_hand_comes_to_rest(
    scene: Scene, until: Any, victim: str, signal_number: signal.Signals
) -> None:
    commander = scene.armed(until)
    moving = scene.twin.start("command", "move", "rh_FFJ3=1.4", "--seconds", "60")
    until(lambda: len(scene.sent) > 20, 30.0)
    process = {"commander": moving, "daemon": scene.daemon, "hand": scene.hand}[victim]
    os.kill(process.pid, signal_number)
    if victim == "daemon":
        count = until(lambda: (n := len(scene.sent)) and not _grows(scene, n) and n, 10.0)
        if signal_number == signal.SIGSTOP:
            time.sleep(SLOW_MACHINE["state_timeout_s"] + 0.2)
            os.kill(process.pid, signal.SIGCONT)
            ended = until(lambda: (s := commander.status(20.0))["mode"] == "read_only" and s["ended"], 20.0)
            assert "stood still" in ended or "silent" in ended or "last heard" in ended
            assert len(scene.sent) <= count + 5
    else:
        word = "silent" if victim == "commander" else "last heard"
        ended = until(lambda: (s := commander.status())["mode"] == "read_only" and s["ended"], 15.0)
        assert word in ended
        until(lambda: not _grows(scene, len(scene.sent)), 5.0)
        trips = [entry for entry in entries_of(scene.log) if entry["verb"] == "trip"]
        assert [entry["check"] for entry in trips] == [{"commander": "commander", "hand": "stale"}[victim]]
    assert not verify(scene.log).broken
    assert scene.sent[-1].position[0] < 1.0
    os.kill(process.pid, signal.SIGKILL)


def _grows(scene: Scene, count: int) -> bool:
    time.sleep(0.5)
    return len(scene.sent) > count


@pytest.mark.slow
def test_a_calibration_run_drives_records_and_stores(scene: Scene, until: Any) -> None:
    until(lambda: scene.heard(), 20.0)
    code, out, err = scene.twin.run(
        "calibrate", "--run", "hand_closing", "--space", "first-approach", "--budget", "60", "--json", "-"
    )
    assert code == 0, err
    found = json.loads(out)
    assert found["version"]
    assert found["after"]["mse_rad2"] < found["before"]["mse_rad2"]
    assert scene.commander().status()["mode"] == "read_only"
    verbs = [entry["verb"] for entry in entries_of(scene.log) if entry["accepted"]]
    assert verbs == ["arm", "trajectory", "disarm"]


@pytest.mark.slow
def test_a_run_that_is_stopped_half_way_keeps_what_it_has(scene: Scene, state_dir: Path, until: Any) -> None:
    until(lambda: scene.heard(), 20.0)
    run = scene.twin.start("calibrate", "--run", "hand_closing", "--budget", "20", "--json", "-")
    until(lambda: len(scene.sent) > 100, 40.0)
    assert scene.twin.run("command", "stop", "--reason", "smoke")[0] == 0
    code, out, err = scene.twin.finish(run)
    assert code == 4, err
    assert out == ""
    assert "smoke" in err
    kept = list((state_dir / "recordings").glob("run-*.mcap"))
    assert len(kept) == 1
    assert scene.twin.run("check", "--recording", str(kept[0]))[0] == 0
    assert scene.commander().status()["mode"] == "stopped"
    assert "candidate" not in json.loads(scene.twin.run("versions", "list", "--json", "-")[1])["aliases"]


@pytest.mark.slow
def test_two_sessions_of_one_name_do_not_share_the_hand(scene: Scene, until: Any) -> None:
    """Each 'twin command' is a process of its own, and goes on with the lease of the one that armed."""
    holder = scene.armed(until)
    code, _, err = scene.twin.run("command", "arm", "--reason", "mine")
    assert code == 4
    assert "another session" in err
    second = scene.commander()
    assert second.ask("move", targets={"rh_FFJ3": 0.5})["check"] == "lease"
    assert holder.ask("move", targets={"rh_FFJ3": 1.4}, seconds=60.0)["accepted"]
    until(lambda: scene.sent)
    ended: list[Any] = []
    # the holder is silent from here; the second session beats, streams and asks for whatever it may
    publisher = second.stream_to()

    def over() -> bool:
        second.ask("beat")
        second.ask("recalibrate")
        second.stream(publisher, {"rh_FFJ3": 0.1})
        ended.append(second.status()["ended"])
        return ended[-1]

    assert "silent" in until(over, 20.0)
    publisher.undeclare()
    assert second.ask("arm", reason="now it is free", sequence=2**63 - 1)["check"] == "order"
    assert second.ask("arm", reason="now it is free")["accepted"]
    assert scene.twin.run("command", "disarm")[0] == 0  # a lost session is ended in its name
    assert scene.twin.run("command", "arm", "--reason", "mine")[0] == 0
    assert scene.twin.run("command", "arm", "--reason", "longer", "--renew", "--lease", "100")[0] == 0
    assert scene.twin.run("command", "move", "rh_FFJ3=0.2")[0] == 0
    assert holder.ask("move", targets={"rh_FFJ3": 0.5})["check"] == "lease"
