"""At 125 Hz whoever is lost is missed so soon that the hand has its last moving command within 0.1 s."""

from __future__ import annotations

import pytest

from tests.gate.conftest import ANN, Rig
from twin_daemon.gate.settings import GateSettings
from twin_daemon.simulation.twin import TwinModel

WITHIN_S = 0.1


@pytest.mark.parametrize("lost", ["hand", "commander", "daemon"])
def test_the_last_command_that_moves_comes_within_a_tenth_of_a_second(twin: TwinModel, lost: str) -> None:
    rig = Rig(twin)
    rig.arm()
    assert rig.ask("move", ANN, targets={"rh_FFJ3": 1.4}, seconds=4.0)["accepted"]
    for _ in range(125):
        rig.ask("beat", ANN)
        assert rig.turn() is not None
    lost_s, moved_s, before = rig.now_s, rig.now_s, None
    for _ in range(60):
        if lost != "commander":
            rig.ask("beat", ANN)
        rig.speaks = lost != "hand"
        if lost == "daemon" and rig.now_s - lost_s > rig.gate.settings.state_timeout_s:
            rig.gate.end("daemon", "the daemon has been silent", rig.now_s)  # as its keeper does in each turn
        sent = rig.turn()
        position = None if sent is None else tuple(sent.position)
        if position is not None and position != before:
            before, moved_s = position, rig.now_s
        if rig.status["mode"] != "armed" and not rig.status["moving"]:
            break
    assert rig.status["mode"] == "read_only"
    assert 0.0 < moved_s - lost_s <= WITHIN_S, rig.status["ended"]


def test_a_commander_who_speaks_seldom_is_not_missed_sooner_than_he_is_used_to_speak(rig: Rig) -> None:
    rig.arm()
    assert rig.ask("move", ANN, targets={"rh_FFJ3": 1.4}, seconds=8.0)["accepted"]
    for number in range(500):
        if number % 12 == 0:  # 10 Hz
            rig.ask("beat", ANN)
        rig.turn()
    assert rig.status["mode"] == "armed", rig.status["ended"]


def test_a_slower_hand_may_be_silent_for_nine_of_its_periods() -> None:
    assert GateSettings().for_rate(125.0).state_timeout_s <= 0.08
    assert GateSettings().for_rate(1000.0).state_timeout_s <= 0.08
    assert GateSettings().for_rate(30.0).state_timeout_s == pytest.approx(0.3)
    assert GateSettings(state_timeout_s=0.05).for_rate(30.0).state_timeout_s == 0.05


def test_the_time_that_a_plan_takes_is_not_the_commanders_silence(rig: Rig) -> None:
    rig.arm()
    for _ in range(200):  # one who is used to speak 125 times a second
        rig.ask("beat", ANN)
        rig.turn()
    planned_s = rig.now_s + 0.5
    rig.gate.clock = lambda: planned_s
    assert rig.ask("move", ANN, targets={"rh_FFJ3": 1.4}, seconds=8.0)["accepted"]
    rig.now_s = planned_s
    rig.hear()
    rig.gate._last_turn_s = planned_s  # the turns went on meanwhile
    rig.turn()
    assert rig.status["mode"] == "armed", rig.status["ended"]
