"""A hand that says what cannot be: it is not armed, not moved, or the motion ends, and somebody is told why."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.gate.conftest import Rig
from tests.gate.test_contact import PlantRig
from twin_daemon.errors import BadInput
from twin_daemon.gate.preview import Preview
from twin_daemon.gate.sendable import Sendable
from twin_daemon.hand import load_hand
from twin_daemon.plant import Faulty, parse_fault
from twin_daemon.security.identity import NOBODY
from twin_daemon.simulation.twin import TwinModel


class LyingRig(PlantRig):
    """A sound hand whose driver does not tell the truth."""

    def __init__(self, twin: TwinModel, faults: Sequence[str], **settings: Any) -> None:
        self.faults = [parse_fault(text, twin.hand) for text in faults]
        self.driver: Faulty | None = None
        super().__init__(twin, **settings)

    def hear(self) -> None:
        if self.driver is None:
            self.driver = Faulty(self.plant, self.faults)
        names, self.reading, _, effort = self.driver.measure()
        self.gate.measured(self.reading, np.full(len(self.joints), self.now_s), dict(zip(names, effort, strict=True)))

    def angle(self, joint: str = "rh_FFJ3") -> float:
        """Where it truly is, rad."""
        return float(self.plant.position[self.joints.index(joint)])


@pytest.mark.parametrize(
    ("faults", "trip", "words"),
    [
        (["degrees"], "too_far", "unit rad"),
        (["dead:rh_FFJ3"], "frozen", "not moved at all"),
        (["reversed:rh_FFJ3"], "wrong_way", "should have moved by +"),
    ],
)
@pytest.mark.parametrize("seconds", [0.8, None, 6.0])
def test_a_sensor_that_lies_ends_the_motion_before_it_has_gone_far(
    twin: TwinModel, faults: list[str], trip: str, words: str, seconds: float | None
) -> None:
    rig = LyingRig(twin, faults)
    rig.arm()
    began = rig.angle()
    assert rig.ask("move", targets={"rh_FFJ3": 1.4}, seconds=seconds)["accepted"]
    rig.until_it_ends(7.0)
    assert rig.status["mode"] == "read_only"
    assert rig.entries[-1]["check"] in (trip, "tracking", "implausible")
    if seconds is None and trip != "too_far":
        assert rig.entries[-1]["check"] == trip
        assert words in rig.status["ended"]
    far = abs(rig.angle() - began)
    assert far < 0.6
    angles = []
    for _ in range(200):
        rig.turn()
        angles.append(rig.angle())
    farthest = float(np.abs(np.array(angles) - began).max())
    assert farthest <= far + 0.15
    assert not rig.status["moving"]


@pytest.mark.parametrize("seconds", [0.8, 1.5, None])
def test_a_reversed_sensor_is_told_before_the_joint_has_left_its_range(twin: TwinModel, seconds: float | None) -> None:
    rig = LyingRig(twin, ["reversed:rh_FFJ3"])
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 1.4}, seconds=seconds)["accepted"]
    rig.until_it_ends(5.0)
    assert rig.entries[-1]["check"] == "wrong_way"
    assert rig.measured() > twin.hand.joint_range_rad["rh_FFJ3"][0]


def test_where_the_site_waits_for_longer_the_range_ends_it_and_the_cause_is_told(twin: TwinModel) -> None:
    """Half a second at 0.8 rad/s is 0.4 rad: the reading is beyond its range by the tolerance before."""
    rig = LyingRig(twin, ["reversed:rh_FFJ3"], tracking_time_s=0.5)
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 1.2}, seconds=1.5)["accepted"]
    rig.until_it_ends(5.0)
    assert rig.entries[-1]["check"] == "implausible"
    assert "its sensor is reversed; rh_FFJ3 reads -0.4" in rig.status["ended"]


@pytest.mark.parametrize("pair", ["dead:rh_FFJ1", "reversed:rh_FFJ1", "reversed:rh_FFJ2"])
def test_one_lying_sensor_of_a_pair_is_noticed(twin: TwinModel, pair: str) -> None:
    rig = LyingRig(twin, [pair])
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ0": 2.5})["accepted"]
    rig.until_it_ends(5.0)
    assert rig.entries[-1]["verb"] == "trip"


@pytest.mark.parametrize("verb", ["move", "target", "trajectory"])
def test_what_is_beyond_reach_is_neither_believed_nor_clipped(rig: Rig, verb: str) -> None:
    rig.pose[rig.joints.index("rh_FFJ3")] = 2.0
    rig.now_s += 1.0
    rig.hear()
    refused = rig.ask("arm", reason="a test")
    assert refused["check"] == "implausible"
    assert "2.000 rad" in refused["why"]
    rig.pose[rig.joints.index("rh_FFJ3")] = 1.5
    for _ in range(100):
        rig.now_s += 0.01
        rig.hear()
    rig.arm()
    rig.pose[rig.joints.index("rh_FFJ3")] = 1.9
    rig.now_s += 0.5
    rig.hear()
    body: dict[str, Any] = {"targets": {"rh_MFJ3": 0.1}}
    if verb == "trajectory":
        body = {"joints": ["rh_MFJ3"], "times_s": [0.0, 2.0], "positions": [[0.0], [0.1]]}
    assert rig.ask(verb, **body)["check"] == "implausible"
    assert rig.turn() is None
    assert rig.status["mode"] == "read_only"
    assert "2.0" not in rig.status["ended"]


def test_real_hands_read_a_little_beyond_their_range(rig: Rig) -> None:
    """0.119 rad in the recordings of the Shadow Hand."""
    rig.pose[rig.joints.index("rh_FFJ2")] = 1.5708 + 0.119
    rig.now_s += 1.0
    rig.hear()
    rig.arm()
    assert rig.ask("move", targets={"rh_MFJ3": 0.1})["accepted"]


def test_what_is_faster_than_a_hand_can_be_trips(rig: Rig) -> None:
    rig.arm()
    rig.ask("move", targets={"rh_MFJ3": 1.0})
    rig.turns(0.3)
    rig.pose[rig.joints.index("rh_LFJ3")] += 0.4
    rig.turn()
    assert rig.entries[-1]["check"] == "implausible"
    assert "just before" in rig.status["ended"]


def test_the_first_command_starts_near_all_recent_states(rig: Rig) -> None:
    """Two sources of states that differ by less than a jump; and a limit of the site that the hand is beyond."""
    rig.arm()
    index = rig.joints.index("rh_FFJ3")
    for number in range(80):
        rig.pose[index] = 0.4 + 0.09 * (-1) ** number
        rig.now_s += 0.01
        rig.hear()
    refused = rig.ask("move", targets={"rh_FFJ3": 0.6})
    assert refused["check"] == "start"
    assert rig.ask("move", targets={"rh_MFJ3": 0.3})["accepted"]


def test_a_hand_outside_the_limits_of_the_site_is_not_pulled_inside(twin: TwinModel) -> None:
    rig = Rig(twin, limits={"rh_FFJ3": {"upper_rad": 0.5}})
    rig.pose[rig.joints.index("rh_FFJ3")] = 1.2
    rig.now_s += 1.0
    rig.hear()
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 0.3})["check"] == "start"
    assert rig.turn() is None


def test_after_a_reading_that_cannot_be_no_setpoint_goes_there(twin: TwinModel) -> None:
    rig = LyingRig(twin, [])
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 0.8}, seconds=1.0)
    rig.turns(0.6)
    before = rig.setpoint()
    rig.faults.append(parse_fault("reversed:rh_FFJ3", load_hand()))
    for _ in range(100):
        rig.turn()
    assert rig.status["mode"] == "read_only"
    assert rig.setpoint() == pytest.approx(before, abs=0.1)
    rig.ask("stop", NOBODY)
    sent: list[Sendable | None] = [rig.turn() for _ in range(100)]
    assert all(one is None or one.position[0] > -0.1 for one in sent)


def test_what_cannot_be_calls_no_setpoint_back_while_the_hand_lets_go(twin: TwinModel) -> None:
    """A sensor that has proved itself, and that counts the wrong way from just after a stop on."""
    rig = LyingRig(twin, [])
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 0.8, "rh_MFJ3": 0.8}, seconds=0.8)
    rig.turns(0.6)
    rig.ask("stop", NOBODY)
    rig.turns(0.1, beat=False)
    before = rig.setpoint()
    rig.faults.append(parse_fault("reversed:rh_FFJ3", load_hand()))
    rig.turns(1.0, beat=False)
    assert rig.setpoint() == pytest.approx(before, abs=0.05)
    assert not rig.status["moving"]


class DeadRig(Rig):
    """A hand that goes where it is sent; some of its sensors tell for ever what they told when they died."""

    dead: dict[str, float] | None = None

    def hear(self) -> None:
        reading = self.pose.copy()
        for name, told in (self.dead or {}).items():
            reading[self.joints.index(name)] = told
        self.gate.measured(reading, np.full(len(self.joints), self.now_s))


def test_what_a_dead_sensor_calls_back_stays_clear_of_a_neighbour_that_has_moved_meanwhile(twin: TwinModel) -> None:
    """Where the middle finger was when its sensor died the ring finger is now; the index finger's way is free."""
    rig = DeadRig(twin)
    rig.arm()
    fingers = ("rh_FFJ3", "rh_MFJ3")
    for targets in (dict.fromkeys(fingers, 0.09), dict.fromkeys(fingers, 0.14), {"rh_RFJ4": 0.1}):
        assert rig.ask("move", targets=targets, seconds=0.3)["accepted"]
        rig.turns(0.6)
        rig.dead = rig.dead or {name: float(rig.pose[rig.joints.index(name)]) for name in fingers}
    assert rig.status["ended"] == "done"
    rig.ask("stop", NOBODY)
    sent = rig.turns(1.0, beat=False)
    preview = Preview(twin, 0.001)
    for one in sent:
        targets = np.array([dict(zip(one.names, one.position, strict=True)).get(c, np.nan) for c in twin.hand.commands])
        assert preview.along(rig.pose, targets[None], now=np.zeros(len(targets))) is None
    index, middle, _ = sent[-1].position
    assert index == pytest.approx(0.10, abs=0.002)
    assert index + 0.01 < middle < 0.13
    assert f"rh_MFJ3 stays {middle - 0.1:.2f} rad away" in rig.status["ended"]
    assert not rig.status["moving"]


def test_a_fault_that_is_none_is_refused(twin: TwinModel) -> None:
    with pytest.raises(BadInput, match="no fault"):
        parse_fault("dad:rh_FFJ3", twin.hand)
    with pytest.raises(BadInput, match="no joint"):
        parse_fault("dead:rh_FFJ33", twin.hand)
