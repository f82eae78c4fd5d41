"""From a request to what is sent: smooth, within limits, and at rest as soon as anything is lost."""

from __future__ import annotations

import ast
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.gate_streams import Stream
from tests.gate.conftest import ANN, BOB, Rig
from twin_daemon.errors import BadInput
from twin_daemon.gate.requests import KINDS
from twin_daemon.gate.sendable import Sendable
from twin_daemon.simulation.twin import TwinModel

ROOT = Path(__file__).resolve().parents[2]


def test_a_gate_that_nobody_armed_sends_nothing(rig: Rig) -> None:
    assert rig.status["mode"] == "read_only"
    assert not rig.ask("move", targets={"rh_FFJ3": 0.5})["accepted"]
    assert rig.turns(1.0) == []


def test_a_move_arrives_smoothly_and_moves_nothing_else(rig: Rig) -> None:
    rig.arm()
    answer = rig.ask("move", targets={"rh_FFJ3": 0.8, "rh_FFJ0": 1.0})
    assert answer["accepted"]
    sent = rig.turns(answer["seconds"] + 0.2)
    assert {one.names for one in sent} == {("rh_FFJ0", "rh_FFJ3")}
    path = np.array([one.position for one in sent])
    assert path[-1] == pytest.approx([1.0, 0.8], abs=1e-6)
    assert (np.diff(path, axis=0) >= -1e-12).all()
    assert rig.status["ended"] == "done"


def test_joints_of_a_pair_are_their_sum(rig: Rig) -> None:
    rig.arm()
    assert rig.ask("move", targets={"FFJ1": 0.2, "FFJ2": 0.6})["accepted"]
    assert rig.turns(2.0)[-1].position == pytest.approx([0.8])
    assert "FFJ0" in rig.ask("move", targets={"rh_FFJ1": 0.2})["why"]
    assert "rh_FFJ3" in rig.ask("move", targets={"rh_FFJ33": 0.2})["why"]


def test_a_trajectory_is_followed_from_where_the_hand_is(rig: Rig) -> None:
    rig.arm()
    rows = [[0.3, 0.5], [1.0, 0.5], [0.2, 0.1]]
    answer = rig.ask("trajectory", joints=["rh_MFJ3", "rh_MFJ0"], times_s=[0.0, 1.5, 3.0], positions=rows)
    assert answer["accepted"], answer
    sent = rig.turns(answer["seconds"] + 0.3)
    path = np.array([one.position for one in sent])
    assert path[0] == pytest.approx([0.0, 0.0], abs=0.02)
    assert path[-1] == pytest.approx([0.1, 0.2], abs=1e-6)
    assert path[:, 1].max() == pytest.approx(1.0, abs=0.01)


def test_a_trajectory_can_say_how_long_the_way_to_its_first_point_takes(rig: Rig) -> None:
    rig.arm()
    once = rig.ask("trajectory", joints=["rh_MFJ3"], times_s=[0.0], positions=[[0.5]], lead_s=2.0)
    assert once["seconds"] == pytest.approx(2.0, abs=0.02)
    path = np.array([one.position[0] for one in rig.turns(2.2)])
    assert path[len(path) // 2] == pytest.approx(0.25, abs=0.05)
    assert path[-1] == pytest.approx(0.5, abs=1e-6)
    hasty = rig.ask("trajectory", joints=["rh_MFJ3"], times_s=[0.0], positions=[[1.5]], lead_s=0.1)
    assert hasty["check"] == "velocity"


def forged(rig: Rig, other_rad: float, later_s: float = 0.0, source: str | None = None) -> None:
    """The last command of the gate as somebody else sends it: with its stamp."""
    rig.gate.own_source = "the gate's own"
    sent = next(one for one in (rig.turn() for _ in range(50)) if one is not None)
    rig.gate.seen(sent.stamp_ns, sent.names, sent.position, rig.now_s, rig.gate.own_source)
    assert rig.status["mode"] == "armed"
    rig.gate.seen(sent.stamp_ns, sent.names, sent.position + other_rad, rig.now_s + later_s, source)


LOSSES: dict[str, tuple[str, Any]] = {
    "commander": ("silent", lambda rig: None),
    "stale": ("last heard", lambda rig: setattr(rig, "speaks", False)),
    "standstill": ("stood still", lambda rig: rig.turn(0.5)),
    "foreign": ("somebody else", lambda rig: rig.gate.seen(5, ("rh_FFJ3",), np.array([0.1]), rig.now_s + 1.0)),
    "foreign, half a pair": (
        "somebody else",
        lambda rig: rig.gate.seen(5, ("rh_FFJ1",), np.array([0.1]), rig.now_s + 1.0),
    ),
    "foreign, unreadable": ("somebody else", lambda rig: rig.gate.seen(5, (), np.zeros(0), rig.now_s + 1.0, "x")),
    "copied stamp": ("somebody else", lambda rig: forged(rig, rig.gate.settings.jump_rad)),
    "sent again later": ("somebody else", lambda rig: forged(rig, 0.0, 2.5)),
    "another publisher": ("somebody else", lambda rig: forged(rig, 0.0, source="another")),
    "second source": ("two hands", lambda rig: rig.gate.doubt("second_source", "two hands", rig.now_s)),
    "disarm": ("disarmed", lambda rig: rig.ask("disarm")),
    "stop": ("stopped", lambda rig: rig.ask("stop", BOB)),
}


@pytest.mark.parametrize("loss", LOSSES)
def test_whatever_is_lost_the_hand_comes_to_rest_and_stays(rig: Rig, loss: str) -> None:
    text, lose = LOSSES[loss]
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.4}, seconds=3.0)
    before = rig.turns(1.0)[-1].position
    assert rig.status["moving"]
    lose(rig)
    sent = rig.turns(1.3, beat=False)
    assert text in rig.status["ended"]
    assert rig.status["mode"] != "armed"
    assert not rig.status["moving"]
    last = sent[-1].position if sent else before
    assert before[0] <= last[0] < 1.2  # it was on its way to 1.4
    assert rig.turns(3.0, beat=False) == []
    assert not rig.ask("move", targets={"rh_FFJ3": 0.1})["accepted"]


def test_a_lease_ends(rig: Rig) -> None:
    rig.arm(lease_s=1.0)
    rig.ask("move", targets={"rh_FFJ3": 1.4}, seconds=3.0)
    rig.turns(1.2)
    assert "lease" in rig.status["ended"]
    assert not rig.status["moving"]


def test_a_hand_that_does_not_follow_trips_the_gate(rig: Rig) -> None:
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.4}, seconds=2.0)
    stuck = rig.pose.copy()
    for number in range(400):
        if number % 10 == 0:
            rig.ask("beat")
        rig.turn()
        rig.pose = stuck.copy()
    assert "from where it was sent" in rig.status["ended"]
    assert not rig.status["moving"]


def test_effort_trips_where_a_limit_is_set(twin: TwinModel) -> None:
    rig = Rig(twin, effort_limit={"rh_FFJ3": 100.0})
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.0})
    rig.effort = {"rh_FFJ3": -150.0}
    rig.turns(0.1)
    assert "effort" in rig.status["ended"]


def test_the_way_is_watched_even_where_the_plan_was_free(rig: Rig) -> None:
    """Another finger gets in the way after the plan was made: the setpoints stop before it."""
    rig.arm()
    answer = rig.ask("move", targets={"rh_FFJ4": 0.06}, seconds=2.0)
    assert answer["accepted"], answer["why"]
    rig.turns(0.3)
    rig.pose[rig.joints.index("rh_MFJ4")] = -0.05
    rig.turns(2.0)
    assert "overlap" in rig.status["ended"]
    assert rig.pose[rig.joints.index("rh_FFJ4")] < 0.05


def test_site_limits_can_only_tighten(twin: TwinModel) -> None:
    rig = Rig(twin, limits={"rh_FFJ3": {"upper_rad": 0.5, "velocity_rad_s": 0.1}, "rh_FFJ4": {"upper_rad": 0.349066}})
    names = rig.gate.limits.names
    assert rig.gate.limits.upper[names.index("rh_FFJ3")] == 0.5
    assert rig.gate.limits.upper[names.index("rh_FFJ4")] == pytest.approx(0.349066)
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 0.6})["check"] == "bounds"
    path = np.array([one.position[0] for one in (rig.ask("move", targets={"rh_FFJ3": 0.1}), rig.turns(6.0))[1]])
    assert np.abs(np.diff(path)).max() <= 0.1 * 0.008 + 1e-12


@pytest.mark.parametrize(
    "limits", [{"rh_FFJ33": {}}, {"rh_FFJ3": {"lower_rad": 2.0, "upper_rad": 3.0}}], ids=["unknown", "nothing left"]
)
def test_limits_that_cannot_be_are_refused(twin: TwinModel, limits: dict[str, Any]) -> None:
    with pytest.raises(BadInput):
        Rig(twin, limits=limits)


def test_a_rehearsal_moves_nothing_and_says_what_would_happen(rig: Rig) -> None:
    answer = rig.ask("move", targets={"rh_FFJ3": 1.0, "rh_FFJ0": 1.0}, dry_run=True)
    assert answer["accepted"]
    tried = answer["rehearsal"]
    assert tried["duration_s"] == pytest.approx(answer["seconds"], abs=0.1)
    assert 0.0 < tried["peak_effort"]["rh_FFJ3"] <= 2.0
    assert 0.0 < tried["tracking_error_rad"]["rh_FFJ0"] < 0.5
    assert rig.turns(0.5) == []
    refused = rig.ask("move", targets={"rh_FFJ3": 9.0}, dry_run=True)
    assert refused["check"] == "bounds"
    assert refused["rehearsal"] is None


def test_what_cannot_be_recorded_is_not_done_but_a_stop_is(rig: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    rig.arm()

    def full(_: dict[str, Any]) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(rig.gate, "audit_sink", full)
    refused = rig.ask("move", targets={"rh_FFJ3": 0.5})
    assert refused["check"] == "record"
    assert "audit log" in refused["why"]
    assert rig.ask("stop")["accepted"]
    assert rig.status["mode"] == "stopped"


def test_what_leaves_the_gate_is_within_every_limit(twin: TwinModel) -> None:
    """Lives of gates under random treatment; `python -m bench.gate_streams` lives a million commands."""
    seen = sum((Stream(twin, seed).run(150) for seed in range(8)), start=Stream(twin, 0).answers)
    assert seen["accepted"] > 200
    assert seen["sent"] > 300
    assert {"bounds", "collision", "identity", "role", "order", "fresh", "session", "jump", "finite"} <= set(seen)


def test_only_the_gate_makes_a_command_sendable() -> None:
    with pytest.raises(TypeError, match="only the gate"):
        Sendable(1, 1, ("rh_FFJ3",), np.zeros(1), object())
    users = {
        path.relative_to(ROOT).as_posix()
        for folder in ("twin_daemon", "bridges")
        for path in (ROOT / folder).rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (isinstance(node, ast.Name) and node.id in ("make_sendable", "_SEAL"))
        or (isinstance(node, ast.alias) and node.name in ("make_sendable", "_SEAL"))
        or (isinstance(node, ast.Attribute) and node.attr in ("make_sendable", "_SEAL"))
    }
    assert users == {"twin_daemon/gate/sendable.py", "twin_daemon/gate/command_output.py"}


def test_commanders_do_not_interleave(rig: Rig) -> None:
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.0})
    assert rig.ask("move", BOB, targets={"rh_FFJ3": 0.0})["check"] == "armed"
    assert rig.ask("arm", BOB, reason="mine")["check"] == "commander"
    assert rig.turns(3.0)[-1].position == pytest.approx([1.0])
    rig.ask("disarm")
    assert rig.ask("arm", BOB, reason="mine now")["accepted"]
    assert rig.ask("move", ANN, targets={"rh_FFJ3": 0.0})["check"] == "armed"


def test_of_a_request_that_comes_twice_at_once_only_the_first_counts(rig: Rig) -> None:
    rig.arm()
    request = KINDS["beat"]
    with ThreadPoolExecutor(8) as pool:
        for sequence in range(100, 200):
            same = request(session="now", sequence=sequence, stamp_ns=rig.wall_ns, lease=rig.lease)
            asked = [pool.submit(rig.gate.ask, "beat", same, ANN, rig.now_s, rig.wall_ns) for _ in range(8)]
            assert sum(one.result()["accepted"] for one in asked) == 1
