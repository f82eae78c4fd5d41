"""A lease is one session of somebody: others in his name neither command nor keep his motion alive."""

from __future__ import annotations

from typing import Any

import pytest

from tests.gate.conftest import ANN, BOB, Rig
from twin_daemon.gate.requests import KINDS


def ask_elsewhere(rig: Rig, verb: str, **body: Any) -> dict[str, Any]:
    """What another session of ann asks: it has her key, and not the lease."""
    rig.sequence += 1
    given = {"session": "now", "sequence": rig.sequence, "stamp_ns": rig.wall_ns, **body}
    return rig.gate.ask(verb, KINDS[verb](**given), ANN, rig.now_s, rig.wall_ns)


@pytest.mark.parametrize("guess", ["", "0" * 32, "\u00e9" * 32], ids=["none", "wrong", "not ascii"])
def test_a_second_session_in_the_same_name_holds_nothing(rig: Rig, guess: str) -> None:
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 1.0}, seconds=2.0)["accepted"]
    rig.turns(0.5)
    refused = ask_elsewhere(rig, "arm", reason="mine", lease=guess)
    assert refused["check"] == "commander"
    assert "another session" in refused["why"]
    assert "lease" not in refused
    for verb, body in (
        ("move", {"targets": {"rh_FFJ3": 0.0}}),
        ("target", {"targets": {"rh_FFJ3": 0.1}}),
        ("trajectory", {"joints": ["rh_FFJ3"], "times_s": [0.0], "positions": [[0.0]]}),
        ("beat", {}),
    ):
        assert ask_elsewhere(rig, verb, lease=guess, **body)["check"] == "lease", verb
    assert rig.turns(2.0)[-1].position == pytest.approx([1.0])


def test_only_the_holder_keeps_his_motion_alive(rig: Rig) -> None:
    """The holder dies; others beat, stream, recalibrate and rehearse in his name and in theirs."""
    rig.arm()
    assert rig.ask("move", targets={"rh_FFJ3": 1.4}, seconds=20.0)["accepted"]
    for _ in range(120):
        ask_elsewhere(rig, "beat")
        ask_elsewhere(rig, "recalibrate")
        rig.ask("recalibrate", BOB)
        rig.ask("beat", BOB)
        ask_elsewhere(rig, "target", targets={"rh_FFJ3": 0.1})
        rig.ask("move", targets={"rh_FFJ3": 0.1}, dry_run=True) if rig.sequence % 100 == 0 else None
        rig.turns(0.016, beat=False)
    assert "silent" in rig.status["ended"]


def test_the_holder_renews_and_a_lost_session_is_ended_in_its_name(rig: Rig) -> None:
    rig.arm(lease_s=1.0)
    lease = rig.lease
    rig.turns(0.8)
    rig.arm(lease_s=1.0)
    assert rig.lease == lease
    rig.turns(0.8)
    assert rig.status["mode"] == "armed"
    assert ask_elsewhere(rig, "disarm")["accepted"]
    assert rig.status["mode"] == "read_only"
    assert rig.ask("move", targets={"rh_FFJ3": 1.0})["check"] == "armed"
    assert ask_elsewhere(rig, "arm", reason="mine")["lease"] != lease


def test_a_lease_is_told_once_and_to_its_holder_alone(rig: Rig) -> None:
    rig.arm()
    answers = [rig.status, rig.ask("beat"), rig.ask("beat", BOB), rig.ask("move", targets={"rh_FFJ3": 0.1})]
    assert rig.lease
    assert rig.lease not in repr(answers) + repr(rig.entries)


def test_a_sequence_too_large_is_refused_and_locks_nobody_out(rig: Rig) -> None:
    for sequence in (2**63 - 1, rig.wall_ns + 10**13):
        refused = rig.ask("arm", reason="x", sequence=sequence)
        assert refused["check"] == "order"
        assert "too large" in refused["why"]
    rig.arm()
    assert rig.ask("beat", sequence=2**63 - 1)["check"] == "order"
    assert rig.ask("beat")["accepted"]
    # in the same name a session elsewhere counts far ahead of the holder
    ask_elsewhere(rig, "recalibrate", sequence=rig.wall_ns)
    assert rig.ask("beat")["accepted"]
    assert rig.ask("beat", sequence=rig.sequence)["check"] == "order"


def test_a_heartbeat_that_overtakes_takes_nothing_from_what_was_asked_before(rig: Rig) -> None:
    """Each verb is heard in a thread of its own, so that the later request may be heard first."""
    rig.arm()
    asked, rig.sequence = rig.sequence + 1, rig.sequence + 1
    assert rig.ask("beat")["accepted"]
    assert rig.ask("move", targets={"rh_FFJ3": 0.3}, sequence=asked)["accepted"]
    again = rig.ask("move", targets={"rh_FFJ3": 0.3}, sequence=asked)
    assert (again["check"], again["accepted"]) == ("order", False)
    # of two motions the later one counts, and to disarm is never too late
    older, rig.sequence = rig.sequence + 1, rig.sequence + 1
    assert rig.ask("target", targets={"rh_FFJ3": 0.1})["accepted"]
    trajectory = {"joints": ["rh_FFJ3"], "times_s": [0.0], "positions": [[0.3]]}
    assert rig.ask("trajectory", **trajectory, sequence=older)["check"] == "order"
    assert rig.ask("disarm", sequence=older)["accepted"]


def test_a_request_of_before_a_restart_says_so_and_what_to_do(rig: Rig) -> None:
    answer = rig.ask("arm", reason="a test", session="before")
    assert (answer["accepted"], answer["check"]) == (False, "session")
    assert answer["why"] == "the gate was started again since this request was prepared"
    assert answer["allowed"] == "the session that status tells"
