"""Commands over ROS 2: every way in leads through the gate, and what comes out is what left it."""

from __future__ import annotations

import ast
import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
import zenoh

from bridges.zenoh.commander import Commander
from bridges.zenoh.session import open_client, session_config
from bridges.zenoh.sources import Sources
from tests.bridges.ros_network import Peer, needs_ros
from tests.processes.conftest import SLOW_MACHINE, Twin, until
from twin_daemon.daemon import cdr
from twin_daemon.daemon.messages import JointSample
from twin_daemon.gate.audit import entries_of
from twin_daemon.hand import load_hand

ROOT = Path(__file__).resolve().parents[2]
NS = "shadow_hand"
SLOW_JOINT = {"rh_MFJ3": {"velocity_rad_s": 0.02}}
TRAJECTORY = "/rh_trajectory_controller/command"
FFJ3, FFJ0 = "/sh_rh_ffj3_position_controller/command", "/sh_rh_ffj0_position_controller/command"


# -- by reading the code -------------------------------------------------------------------------------------


def trees() -> dict[str, ast.Module]:
    files = sorted((ROOT / "bridges" / "ros2").glob("*.py"))
    return {path.name: ast.parse(path.read_text(encoding="utf-8")) for path in files}


def calls(tree: ast.AST, method: str) -> list[ast.Call]:
    found = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    return [call for call in found if isinstance(call.func, ast.Attribute) and call.func.attr == method]


def test_one_place_publishes_commands() -> None:
    """Everywhere else the topics are written out, and none of them is one of commands."""
    published = {
        (call.args[1].value if isinstance(call.args[1], ast.Constant) else ast.unparse(call.args[1]), name)
        for name, tree in trees().items()
        for call in calls(tree, "create_publisher")
    }
    assert {topic for topic, name in published if name != "command_publisher.py"} == {
        "twin/joint_states",
        "twin/residual",
        "/diagnostics",
    }
    assert [name for _, name in published].count("command_publisher.py") == 1


def test_that_place_takes_nothing_but_what_left_the_gate() -> None:
    tree = trees()["command_publisher.py"]
    (publisher,) = [node for node in tree.body if isinstance(node, ast.ClassDef)]
    methods = {node.name for node in publisher.body if isinstance(node, ast.FunctionDef)}
    assert {name for name in methods if not name.startswith("_")} == set()
    (heard,) = calls(tree, "hear")
    keys = [node for node in ast.walk(tree) if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "key"]
    assert ast.unparse(heard.args[0]) == "key"
    assert [ast.unparse(node.value) for node in keys] == ["settings.description.key('command', verb='sent')"]
    # what publishes is only reached from what was heard there
    assert [ast.unparse(call) for call in calls(tree, "_form")] == ["self._form(self._checked(payload), payload)"]


# -- with a daemon and a stand-in hand -----------------------------------------------------------------------


class Scene:
    """A daemon, a hand that waits for commands, and a session of somebody who watches."""

    def __init__(self, twin: Twin, tmp_path: Path, state_dir: Path, **more: Any) -> None:
        config = tmp_path / "twin.yaml"
        config.write_text(yaml.safe_dump({"gate": {**SLOW_MACHINE, "limits": SLOW_JOINT}, **more}))
        self.twin = twin
        self.log = state_dir / "hands" / NS / "audit.jsonl"
        twin.start("run", "-c", str(config))
        until((state_dir / "keys.json").exists, 60.0)
        twin.start("hand", "--trajectory", "none")
        session = open_client(twin.endpoint, 60.0, name="viewer")
        assert session is not None
        self.session = session
        self.commander = Commander(session, load_hand().description)
        self.measured: dict[str, float] = {}
        self._ear = session.declare_subscriber(f"{NS}/joint_states", self._state)

    def _state(self, sample: zenoh.Sample) -> None:
        state = cdr.decode(sample.payload.to_bytes())
        self.measured = dict(zip(state.names, state.position.tolist(), strict=True))

    def gate(self) -> dict[str, Any]:
        return self.commander.status(20.0)

    def is_at(self, **joints: float) -> bool:
        return all(abs(self.measured[f"rh_{name}"] - value) < 0.1 for name, value in joints.items())

    def refused(self) -> list[tuple[str, str]]:
        return [(entry["verb"], entry["check"]) for entry in entries_of(self.log) if not entry["accepted"]]

    def close(self) -> None:
        self._ear.undeclare()
        self.session.close()


@pytest.fixture
def scene(twin: Twin, tmp_path: Path, state_dir: Path) -> Iterator[Scene]:
    made = Scene(twin, tmp_path, state_dir)
    until(lambda: made.measured, 60.0)
    yield made
    made.close()


@pytest.fixture
def guarded(monkeypatch: pytest.MonkeyPatch, ros: None, tmp_path: Path, state_dir: Path) -> Iterator[Scene]:
    """With access control: hand and bridge speak as the hand, who may not command."""
    monkeypatch.setenv("TWIN_AS", "hand")
    with Twin(tmp_path) as twin:
        made = Scene(twin, tmp_path, state_dir, access={"anonymous": "nothing"})
        until(lambda: made.measured, 60.0)
        yield made
        made.close()


def call(operator: Peer, verb: str) -> dict[str, Any]:
    return operator.do("call", name=f"twin/{verb}")


def armed(operator: Peer) -> dict[str, Any]:
    """The reply once the gate hears the hand."""
    replies: list[dict[str, Any]] = []
    until(lambda: replies.append(call(operator, "arm")) or replies[-1]["success"], 40.0)
    return replies[-1]


def of_the_bridge(operator: Peer, count: str) -> int:
    """The latest count that the bridge has told; 0 as long as there is none."""
    heard = operator.do("take")["diagnostics"]
    return int(heard[-1]["bridge"]["values"].get(count, 0)) if heard else 0


class TestThroughTheGate:
    pytestmark = needs_ros

    def test_without_an_identity_one_may_stop_and_nothing_else(self, scene: Scene, peers: tuple[Peer, Peer]) -> None:
        _, operator = peers
        scene.twin.start("bridge", "ros2", "--ros-args", "-p", "diagnostics_period_s:=0.5")
        refused = until(lambda: (reply := call(operator, "arm"))["success"] is False and reply, 40.0)
        until(lambda: "may look and stop" in call(operator, "arm")["message"], 40.0)
        assert refused["success"] is False
        operator.do("ramp", names=["rh_FFJ3"], start=[0.0], end=[0.2], count=10, rate_hz=50.0)
        operator.do("trajectory", names=["rh_FFJ3"], times_s=[0.5], positions=[[0.2]], topic="twin/trajectory")
        until(lambda: {("arm", "role"), ("target", "role"), ("trajectory", "role")} <= set(scene.refused()))
        until(lambda: of_the_bridge(operator, "command.trajectory.refused"))
        stopped = call(operator, "stop")
        assert stopped["success"] is True, stopped
        assert "no certified stop" in stopped["message"]
        assert scene.gate()["mode"] == "stopped"
        assert scene.gate()["commands_sent"] == 0
        assert call(operator, "release")["success"] is False

    def test_an_operator_moves_the_hand_and_only_within_its_limits(
        self, guarded: Scene, peers: tuple[Peer, Peer]
    ) -> None:
        (driver, operator), scene = peers, guarded
        for topic in (FFJ3, FFJ0):
            driver.do("listen", topic=topic, kind="Float64")
        given = ["identity:=operator", "command_output:=as_described", "arm_reason:=a test", "lease_s:=300.0"]
        options = [word for one in (*given, "diagnostics_period_s:=0.5") for word in ("-p", one)]
        bridge = scene.twin.start("bridge", "ros2", "--ros-args", *options)
        assert "as operator" in armed(operator)["message"]
        assert scene.gate()["reason"] == "a test"
        assert scene.gate()["lease_left_s"] > 100.0

        # a stream of targets, J1 and J2 by their sum
        names = ["rh_FFJ3", "rh_FFJ0"]
        heard: dict[str, list[float]] = {FFJ3: [], FFJ0: []}

        def known() -> bool:
            operator.do("ramp", names=names, start=[0.02, 0.02], end=[0.0, 0.0], count=2, rate_hz=50.0)
            return all(map(driver.do("take").get, heard))

        def arrived() -> bool:
            taken = driver.do("take")
            for topic, values in heard.items():
                values.extend(taken[topic])
            return all(
                values and abs(values[-1] - end) < 1e-6 for values, end in zip(heard.values(), (0.4, 0.6), strict=True)
            )

        until(known)  # a node hears what is published from when it has found who publishes it
        operator.do("ramp", names=names, start=[0.0, 0.0], end=[0.4, 0.6], count=80, rate_hz=50.0)
        until(arrived, 20.0)
        assert np.abs(np.diff(heard[FFJ3])).max() < 0.1
        until(lambda: scene.is_at(FFJ3=0.4))

        # what the twin refuses the hand never sees
        operator.do("ramp", names=names[:1], start=[0.4], end=[3.0], count=1, rate_hz=50.0)
        until(lambda: of_the_bridge(operator, "command.target.refused"))
        assert max(driver.do("take")[FFJ3], default=0.0) < 0.41

        # a trajectory from where the hand is, kept alive by heartbeats
        # (a machine that stands still for seconds ends a motion, as it must; an operator begins it again)
        for _ in range(3):
            # armed anew, the gate forgets how the stream before has ended: that it is done says nothing of what follows
            until(lambda: call(operator, "arm")["success"], 20.0)
            points = {"times_s": [1.0, 4.0], "positions": [[0.3, 0.5], [0.1, 0.0]]}
            operator.do("trajectory", names=names, topic="twin/trajectory", **points)
            operator.do("beat", count=50, rate_hz=10.0)
            ended = until(lambda: not (gate := scene.gate())["moving"] and gate["ended"], 20.0)
            if not any(pause in ended for pause in ("silent", "stood still", "last heard")):
                break
        assert ended == "done"
        until(lambda: scene.is_at(FFJ3=0.1))
        until(lambda: of_the_bridge(operator, "command.beat.accepted") > 3)

        # a stop holds until it is released
        assert call(operator, "stop")["success"] is True
        assert "explicit release" in call(operator, "arm")["message"]
        assert call(operator, "release")["success"] is True
        assert call(operator, "arm")["success"] is True

        # a node that repeats to a controller what the bridge has told it
        operator.do("ramp", names=["rh_FFJ3"], start=[0.1], end=[0.3], count=80, rate_hz=50.0)

        def repeated() -> Any:
            driver.do("copy", topic=FFJ3)
            operator.do("ramp", names=["rh_FFJ3"], start=[0.3], end=[0.3], count=1, rate_hz=50.0)
            return (gate := scene.gate())["mode"] == "read_only" and gate["ended"]

        assert f"past the gate: the ROS 2 node /driver on {FFJ3}" in until(repeated, 20.0)
        until(lambda: call(operator, "arm")["success"], 20.0)

        # the bridge dies while the hand follows a stream
        operator.do("ramp", names=["rh_MFJ3"], start=[0.05], end=[0.25], count=10, rate_hz=50.0)
        until(lambda: scene.gate()["moving"])
        os.kill(bridge.pid, signal.SIGKILL)
        ended = until(lambda: (gate := scene.gate())["mode"] == "read_only" and gate["ended"], 20.0)
        assert "silent" in ended
        until(lambda: not scene.gate()["moving"])
        time.sleep(0.3)
        assert scene.measured["rh_MFJ3"] < 0.2


class TestWaysOut:
    pytestmark = needs_ros

    @pytest.mark.parametrize(
        ("output", "topic", "kind"),
        [
            ("joint_commands", "joint_commands", "JointState"),
            ("trajectory", TRAJECTORY, "JointTrajectory"),
            ("position_controllers", FFJ3, "Float64"),
        ],
    )
    def test_what_left_the_gate_and_nothing_else_is_published(
        self, twin: Twin, peers: tuple[Peer, Peer], output: str, topic: str, kind: str
    ) -> None:
        """The test itself is the other side, so that it can say what no gate would."""
        driver, _ = peers
        driver.do("listen", topic=topic, kind=kind)
        sent, names = "twin/shadow_hand/command/sent", ("rh_FFJ0", "rh_FFJ3")
        end = [0.25] if kind == "Float64" else [0.5, 0.25]
        with zenoh.open(session_config("router", listen=[twin.endpoint])) as router:
            forwarded: list[tuple[JointSample, str]] = []
            sources = Sources(router)

            def hear(sample: zenoh.Sample) -> None:
                forwarded.append((cdr.decode(sample.payload.to_bytes()), sources.named(sources.of(sample))))

            ear = router.declare_subscriber(f"{NS}/joint_commands", hear, allowed_origin=zenoh.Locality.REMOTE)
            bridge = twin.start("bridge", "ros2", "--ros-args", "-p", f"command_output:={output}")

            def said(position: list[float], names: tuple[str, ...] = names, late_s: float = 0.0) -> bytes:
                return cdr.encode(JointSample(time.time_ns() - round(late_s * 1e9), names, np.array(position)))

            until(lambda: router.put(sent, said([0.0, 0.0])) or driver.do("take")[topic], 40.0)
            router.put(f"{NS}/joint_commands", said([9.0, 9.0]))
            router.put("twin/shadow_hand/command/target", said([9.0, 9.0]))
            router.put(sent, said([9.0, 9.0], late_s=5.0))
            router.put(sent, said([9.0, np.nan]))
            router.put(sent, said([9.0], names=("rh_XXJ1",)))
            router.put(sent, b"no CDR at all")
            last = said([0.5, 0.25])
            router.put(sent, last)
            heard: list[Any] = []
            until(lambda: heard.extend(driver.do("take")[topic]) or (heard and positions(heard[-1]) == end))
            assert not any(9.0 in positions(one) for one in heard)
            if kind != "Float64":
                assert heard[-1]["names"] == list(names)
            if kind == "JointTrajectory":
                assert heard[-1]["times_s"] == [pytest.approx(0.008)]
                assert heard[-1]["stamp_s"] == 0
            time.sleep(0.3)
            assert forwarded == [], "what the bridge itself published came back as a command of somebody else"

            # somebody else on any of the topics is somebody else, also with what the bridge has just published
            driver.do("copy", topic=topic)
            copied, by = until(lambda: forwarded and forwarded[0])
            assert copied.position[-1] == 0.25
            assert "/driver" in by
            assert f"on {'/' + topic.lstrip('/')}, through tcp/127.0.0.1" in by
            driver.do("publish", topic="joint_commands", names=["rh_FFJ3"], position=[0.1], count=3, rate_hz=50.0)
            until(lambda: any(said.position.tolist() == [0.1] for said, _ in forwarded))
            driver.do("trajectory", names=["rh_FFJ3"], times_s=[], positions=[], topic=TRAJECTORY)
            until(lambda: any(not said.names for said, _ in forwarded))
            code, _, err = twin.end(bridge, 20.0)
            assert code == 0, err
            assert err.count("a command of the gate failed") == 1
            ear.undeclare()

    def test_an_output_or_identity_that_is_none_is_refused(self, twin: Twin) -> None:
        wrong = {"command_output:=smoke_signals": "position_controllers", "identity:=nobody": "twin run"}
        running = {one: twin.start("bridge", "ros2", "--ros-args", "-p", one) for one in wrong}
        for one, process in running.items():
            code, _, err = twin.finish(process, 60.0)
            assert code == 3, err
            assert wrong[one] in err.splitlines()[-1]


def positions(heard: Any) -> list[float]:
    """Of a JointState, of the only point of a trajectory, or what a position controller is told."""
    if isinstance(heard, float):
        return [heard]
    if "positions" in heard:
        (only,) = heard["positions"]
        return only
    return heard["position"]
