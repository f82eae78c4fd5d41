"""A finger that meets something: the gate notices by what the twin does, and lets go of what it pressed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from tests.gate.conftest import Rig
from twin_daemon.errors import BadInput
from twin_daemon.gate.sendable import Sendable
from twin_daemon.plant import Plant, parse_hidden
from twin_daemon.security.identity import NOBODY
from twin_daemon.signals.trajectory import load_trajectory
from twin_daemon.simulation.twin import TwinModel

WALL_RAD, STIFFNESS = 0.3, 30.0
BLOCKED = f"joint_stop:rh_FFJ3={1.5708 - WALL_RAD},stiffness={STIFFNESS}"


class PlantRig(Rig):
    """A gate and a hand with mass, friction and noise, which hears a command a turn later."""

    def __init__(self, twin: TwinModel, hidden: Sequence[str] = (), seed: int = 0, **settings: Any) -> None:
        effects = [parse_hidden(text, twin.hand) for text in hidden]
        self.plant = Plant(twin.hand, seed=seed, hidden=effects, spread=0.2, step_s=0.002)
        self.plant.advance(0.3)
        self.force: list[float] = []
        self.sent: list[Sendable] = []
        super().__init__(twin, **settings)

    def hear(self) -> None:
        names, self.reading, _, effort = self.plant.measure()
        self.gate.measured(self.reading, np.full(len(self.joints), self.now_s), dict(zip(names, effort, strict=True)))

    def turn(self, after_s: float | None = None) -> Sendable | None:
        self.plant.advance(1.0 / self.gate.settings.rate_hz)
        angle = self.plant.position[self.joints.index("rh_FFJ3")]
        self.force.append(STIFFNESS * max(angle - WALL_RAD, 0.0))
        sent = super().turn(after_s)
        if sent is not None:
            self.sent.append(sent)
            self.plant.set_targets(dict(zip(sent.names, sent.position.tolist(), strict=True)))
        return sent

    def until_it_ends(self, most_s: float) -> float:
        """s from the first touch to the end of the lease; the whole time where nothing was touched."""
        period_s = 1.0 / self.gate.settings.rate_hz
        for number in range(round(most_s / period_s)):
            if number % 10 == 0:
                self.ask("beat")
            self.turn()
            if self.status["mode"] != "armed":
                break
        touched = np.flatnonzero(np.array(self.force) > 0.0)
        return (len(self.force) - (touched[0] if touched.size else 0)) * period_s

    def setpoint(self, name: str = "rh_FFJ3") -> float:
        return float(self.sent[-1].position[self.sent[-1].names.index(name)])

    def measured(self, name: str = "rh_FFJ3") -> float:
        return float(self.reading[self.joints.index(name)])


@pytest.mark.parametrize(("target", "seconds"), [(1.2, None), (0.75, None), (0.45, 6.0), (1.2, 0.65)])
def test_a_blocked_finger_trips_and_lets_go(twin: TwinModel, target: float, seconds: float | None) -> None:
    rig = PlantRig(twin, [BLOCKED])
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": target}, seconds=seconds)["accepted"]
    rig.until_it_ends(10.0)
    assert "from where it was sent" in rig.status["ended"]
    at_trip = rig.force[-1]
    rig.turns(0.3, beat=False)
    assert rig.force[-1] < 0.5 * at_trip
    assert abs(rig.setpoint() - rig.measured()) < 0.03
    rig.turns(1.0, beat=False)
    assert rig.force[-1] < 0.5 * at_trip
    assert not rig.status["moving"]


def test_whoever_arms_again_at_once_does_not_keep_it_from_letting_go(twin: TwinModel) -> None:
    rig = PlantRig(twin, [BLOCKED])
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 1.2}, seconds=0.65)["accepted"]
    rig.until_it_ends(10.0)
    rig.arm()
    rig.turn()
    rig.ask("stop")
    rig.turns(1.0)
    assert abs(rig.setpoint() - rig.measured()) < 0.03


def test_no_motion_begins_while_the_hand_lets_go(twin: TwinModel) -> None:
    """It would begin from setpoints beyond the contact, and leave them there."""
    rig = PlantRig(twin, [BLOCKED])
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 1.2}, seconds=0.65)["accepted"]
    rig.until_it_ends(10.0)
    rig.arm()
    rig.turn()
    refused = rig.ask("move", targets={"rh_MFJ3": 0.3})
    assert refused["check"] == "letting_go"
    rig.turns(1.0)
    assert abs(rig.setpoint() - rig.measured()) < 0.03
    assert rig.ask("move", targets={"rh_MFJ3": 0.3})["accepted"]


def test_arming_anew_buys_a_finger_that_is_blocked_no_time(twin: TwinModel) -> None:
    rig = PlantRig(twin, [BLOCKED])
    rig.arm()
    farthest = 0.0
    for number in range(120):
        ahead = min(rig.setpoint() if rig.sent else 0.0, 1.1) + 0.2
        rig.ask("target", targets={"rh_FFJ3": ahead})
        rig.turn()
        farthest = max(farthest, rig.setpoint() - rig.measured() if rig.sent else 0.0)
        if number % 8 == 7 and rig.status["mode"] == "armed":  # sooner than a trip comes
            rig.ask("disarm")
            rig.arm()
    assert "from where it was sent" in rig.status["ended"]
    assert farthest < 0.7


def test_a_neighbour_does_not_run_into_a_finger_that_does_not_follow(twin: TwinModel) -> None:
    """Where the middle finger is sent the ring finger has room; where it is, it has not."""
    rig = PlantRig(twin, [f"joint_stop:rh_MFJ3={1.5708 - 0.05},stiffness={STIFFNESS}"], tracking_time_s=1.0)
    rig.arm()
    plan = {"times_s": [0.0, 0.3, 0.8], "positions": [[0.0, 0.0], [0.6, 0.0], [1.0, 0.3]]}
    assert rig.ask("trajectory", joints=["rh_MFJ3", "rh_RFJ4"], **plan)["accepted"]
    rig.until_it_ends(3.0)
    assert "rh_MFJ3 does not follow, and rh_mf" in rig.status["ended"]
    assert rig.setpoint("rh_RFJ4") < 0.15
    rig.turns(1.0, beat=False)
    assert abs(rig.setpoint("rh_MFJ3") - rig.measured("rh_MFJ3")) < 0.03


def test_what_lies_beyond_the_limits_of_the_site_is_let_go_of_as_far_as_they_reach(twin: TwinModel) -> None:
    rig = Rig(twin, limits={"rh_FFJ3": {"lower_rad": 0.2}})
    rig.pose[rig.joints.index("rh_FFJ3")] = 0.3
    rig.now_s += 1.0
    rig.hear()
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 0.6}, seconds=1.0)
    rig.turns(1.2)
    sent = []
    for angle in (*np.linspace(0.6, 0.1, 60), *[0.1] * 120):  # somebody pushes it
        rig.pose[rig.joints.index("rh_FFJ3")] = angle
        rig.now_s += 0.008
        rig.hear()
        sent.append(rig.gate.turn(rig.now_s, rig.wall_ns))
        if angle == 0.1 and rig.status["mode"] != "stopped":
            rig.ask("stop", NOBODY)
    assert [one.position[0] for one in sent if one is not None][-1] == pytest.approx(0.2)
    assert not rig.gate.active


def test_it_trips_within_150_ms_of_being_farther_than_expected(twin: TwinModel) -> None:
    rig = PlantRig(twin, [BLOCKED])
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.2})
    off_s = None
    while rig.status["mode"] == "armed":
        rig.ask("beat")
        rig.turn()
        if off_s is None and rig.gate._monitor.tracking.off:
            off_s = rig.now_s
    assert off_s is not None
    assert rig.now_s - off_s <= 0.15


def test_a_stop_lets_go_of_what_is_pressed_even_after_the_lease_has_ended(twin: TwinModel) -> None:
    rig = PlantRig(twin, [BLOCKED], tracking={"rh_FFJ3": {"floor_rad": 1.0}}, tracking_error_rad=2.0)
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 0.9}, seconds=1.0)
    rig.turns(1.5)
    rig.ask("disarm")
    rig.turns(0.5, beat=False)
    pressed = rig.force[-1]
    assert pressed > 1.0
    rig.ask("stop", NOBODY)
    rig.turns(0.3, beat=False)
    assert rig.force[-1] < 0.3 * pressed
    assert not rig.status["moving"]


def test_where_a_grasp_must_hold_the_setpoint_stays(twin: TwinModel) -> None:
    rig = PlantRig(twin, [BLOCKED], after_trip="hold")
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.2})
    rig.until_it_ends(5.0)
    at_trip, held = rig.force[-1], rig.setpoint()
    rig.turns(0.5, beat=False)
    assert rig.setpoint() == pytest.approx(held, abs=0.05)
    assert rig.force[-1] > 0.8 * at_trip


def test_a_stop_does_not_touch_a_hand_that_somebody_else_has_moved(twin: TwinModel) -> None:
    rig = PlantRig(twin)
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 0.6}, seconds=1.0)
    rig.turns(1.5)
    rig.ask("disarm")
    rig.turns(0.2, beat=False)
    rig.plant.set_targets({"rh_FFJ3": 0.0})
    rig.gate.seen(7, ("rh_FFJ3",), np.array([0.0]), rig.now_s)
    rig.turns(0.5, beat=False)
    sent = len(rig.sent)
    rig.ask("stop", NOBODY)
    rig.turns(0.5, beat=False)
    assert len(rig.sent) == sent


@pytest.mark.parametrize("motion", ["hand_closing", "rich_finger"])
def test_a_sound_hand_does_not_trip(twin: TwinModel, motion: str) -> None:
    rig = PlantRig(twin, seed=2)
    rig.arm()
    plan = load_trajectory(motion, twin.hand).by_command(twin.hand)
    asked = {"joints": list(plan.joints), "times_s": plan.times_s.tolist(), "positions": plan.positions.tolist()}
    answer = rig.ask("trajectory", **asked)
    assert answer["accepted"], answer
    rig.turns(min(answer["seconds"] + 0.5, 7.0))
    assert rig.status["mode"] == "armed", rig.status["ended"]


def test_a_fast_move_of_a_worn_hand_does_not_trip(twin: TwinModel) -> None:
    rig = PlantRig(twin, ["coulomb_friction:rh_FFJ3=mild", "backlash:rh_MFJ3=mild"])
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.4, "rh_FFJ0": 1.5, "rh_MFJ3": 1.4}, seconds=0.8)
    rig.turns(2.0)
    assert rig.status["ended"] == "done"


def test_arming_warns_where_no_effort_limit_can_trip(twin: TwinModel) -> None:
    bare = Rig(twin)
    answer = bare.ask("arm", reason="a test")
    assert "effort limit" in answer["warnings"][0]
    assert bare.entries[-1]["warnings"] == answer["warnings"]
    mute = Rig(twin, effort_limit=dict.fromkeys(twin.joints, 1.0))
    assert "tells no effort" in mute.ask("arm", reason="a test")["warnings"][0]
    whole = PlantRig(twin, effort_limit=dict.fromkeys(twin.joints, 1.0))
    assert whole.ask("arm", reason="a test")["warnings"] == []


def test_where_effort_limits_are_set_a_blocked_finger_trips_by_them(twin: TwinModel) -> None:
    rig = PlantRig(twin, [BLOCKED], effort_limit={"rh_FFJ3": 0.8})
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.2})
    rig.until_it_ends(5.0)
    assert "effort" in rig.status["ended"]
    at_trip = rig.force[-1]
    rig.turns(0.3, beat=False)
    assert rig.force[-1] < 0.5 * at_trip


def test_limits_of_commands_that_are_not_there_are_refused(twin: TwinModel) -> None:
    with pytest.raises(BadInput, match="rh_FFJ33"):
        Rig(twin, tracking={"rh_FFJ33": {}})
    with pytest.raises(BadInput, match="rh_FFJ33"):
        Rig(twin, effort_limit={"rh_FFJ33": 1.0})
