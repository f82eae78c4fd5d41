"""Each check refuses what nothing else refuses: without it, the same request goes through."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.gate.conftest import ANN, BOB, EVE, Rig
from twin_daemon.gate import checks
from twin_daemon.security.identity import NOBODY
from twin_daemon.simulation.twin import TwinModel

Scenario = Callable[[Rig], dict[str, Any]]
FIST = {"rh_FFJ3": 1.5, "rh_FFJ0": 3.0, "rh_THJ4": 1.2, "rh_THJ5": 1.0}


def armed(rig: Rig) -> Rig:
    rig.arm()
    return rig


def stopped(rig: Rig) -> Rig:
    rig.ask("stop")
    return rig


def silent(rig: Rig) -> Rig:
    rig.now_s += 1.0
    return rig


def doubted(rig: Rig) -> Rig:
    rig.gate.doubt("second_source", "a second source", rig.now_s)
    return rig


def one_joint_silent(rig: Rig) -> Rig:
    rig.arm()
    heard_s = np.full(len(rig.joints), rig.now_s)
    heard_s[rig.joints.index("rh_FFJ3")] = -np.inf
    rig.now_s += 0.5
    heard_s[np.isfinite(heard_s)] = rig.now_s
    rig.gate.measured(rig.pose, heard_s)
    return rig


def unlikely(rig: Rig) -> Rig:
    """A driver begins to tell degrees; the joint that is asked to move is another one."""
    rig.arm()
    rig.pose[rig.joints.index("rh_LFJ3")] = 2.0
    rig.now_s += 0.1
    rig.hear()
    return rig


def elsewhere(rig: Rig) -> Rig:
    """Just now the hand was told to be 0.2 rad away, too slowly for a jump."""
    rig.arm()
    for angle in (0.1, 0.2):
        rig.now_s += 0.04
        rig.pose[rig.joints.index("rh_FFJ3")] = angle
        rig.hear()
    return rig


def letting_go(rig: Rig) -> Rig:
    """Stopped in full motion, and armed again at once."""
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 0.5})
    rig.turns(0.2)
    rig.ask("stop")
    rig.ask("release", reason="a test")
    rig.arm()
    return rig


SMALL = {"rh_FFJ3": 0.1}
SCENARIOS: dict[tuple[str, str], Scenario] = {
    ("identity_proved", "arm"): lambda rig: rig.ask("arm", None, reason="x"),
    ("may_command", "arm"): lambda rig: rig.ask("arm", EVE, reason="x"),
    ("of_this_session", "arm"): lambda rig: rig.ask("arm", reason="x", session="before"),
    ("in_order", "arm"): lambda rig: (rig.ask("arm", reason=""), rig.ask("arm", reason="x", sequence=1))[1],
    ("recent", "arm"): lambda rig: rig.ask("arm", reason="x", stamp_ns=rig.wall_ns - 10**10),
    ("not_stopped", "arm"): lambda rig: stopped(rig).ask("arm", reason="x"),
    ("nobody_else", "arm"): lambda rig: armed(rig).ask("arm", BOB, reason="x"),
    ("has_reason", "arm"): lambda rig: rig.ask("arm", reason="  "),
    ("hand_is_heard", "arm"): lambda rig: silent(rig).ask("arm", reason="x"),
    ("hand_is_believed", "arm"): lambda rig: doubted(rig).ask("arm", reason="x"),
    ("readings_can_be", "arm"): lambda rig: unlikely(rig).ask("arm", reason="x"),
    ("armed_by_asker", "disarm"): lambda rig: armed(rig).ask("disarm", BOB),
    ("holds_the_lease", "beat"): lambda rig: armed(rig).ask("beat", BOB),
    ("is_stopped", "release"): lambda rig: rig.ask("release", reason="x"),
    ("has_reason", "release"): lambda rig: stopped(rig).ask("release", reason=""),
    **{
        (check, verb): scenario
        for verb in ("move", "target")
        for check, scenario in {
            "holds_the_lease": lambda rig, verb=verb: armed(rig).ask(verb, BOB, targets=SMALL),
            "something_asked": lambda rig, verb=verb: armed(rig).ask(verb, targets={}),
            "finite": lambda rig, verb=verb: armed(rig).ask(verb, targets={"rh_FFJ3": float("nan")}),
            "joints_are_heard": lambda rig, verb=verb: one_joint_silent(rig).ask(verb, targets=SMALL),
            "readings_can_be": lambda rig, verb=verb: unlikely(rig).ask(verb, targets=SMALL),
            "starts_at_hand": lambda rig, verb=verb: elsewhere(rig).ask(verb, targets=SMALL),
            "has_let_go": lambda rig, verb=verb: letting_go(rig).ask(verb, targets=SMALL),
            "inside_bounds": lambda rig, verb=verb: armed(rig).ask(verb, targets={"rh_WRJ2": 0.2}),
        }.items()
    },
    ("no_collision", "move"): lambda rig: armed(rig).ask("move", targets=FIST),
    ("no_collision", "target"): lambda rig: near_collision(rig).ask("target", targets={"rh_FFJ4": 0.25}),
    ("not_too_fast", "move"): lambda rig: armed(rig).ask("move", targets={"rh_FFJ3": 1.5}, seconds=0.1),
    ("no_jump", "target"): lambda rig: armed(rig).ask("target", targets={"rh_FFJ3": 0.6}),
    ("holds_the_lease", "trajectory"): lambda rig: armed(rig).ask("trajectory", BOB, **plan([[0.0], [0.3]])),
    ("finite", "trajectory"): lambda rig: armed(rig).ask("trajectory", **plan([[0.0], [float("inf")]])),
    ("joints_are_heard", "trajectory"): lambda rig: one_joint_silent(rig).ask("trajectory", **plan([[0.0], [0.3]])),
    ("readings_can_be", "trajectory"): lambda rig: unlikely(rig).ask("trajectory", **plan([[0.0], [0.3]])),
    ("starts_at_hand", "trajectory"): lambda rig: elsewhere(rig).ask("trajectory", **plan([[0.0], [0.3]])),
    ("has_let_go", "trajectory"): lambda rig: letting_go(rig).ask("trajectory", **plan([[0.0], [0.3]])),
    ("inside_bounds", "trajectory"): lambda rig: armed(rig).ask("trajectory", **plan([[0.0], [1.7]])),
    ("not_too_fast", "trajectory"): lambda rig: armed(rig).ask("trajectory", **plan([[0.0], [1.5]], 0.1)),
    ("no_collision", "trajectory"): lambda rig: armed(rig).ask(
        "trajectory", joints=list(FIST), times_s=[0.0, 5.0], positions=[[0.0] * 4, list(FIST.values())]
    ),
}
# refused by an earlier check of the mode already, whatever this one says
UNREACHED = {
    ("not_stopped", "move"),
    ("not_stopped", "trajectory"),
    ("not_stopped", "target"),
    ("something_asked", "trajectory"),
    # every joint of this hand has bounds: tests/gate/test_limits.py has one that has none
    ("has_bounds", "move"),
    ("has_bounds", "trajectory"),
    ("has_bounds", "target"),
}


def plan(rows: list[list[float]], seconds: float = 2.0) -> dict[str, Any]:
    return {"joints": ["rh_FFJ3"], "times_s": [0.0, seconds], "positions": rows}


def near_collision(rig: Rig) -> Rig:
    """The middle finger leans over to the first one."""
    rig.now_s += 0.1
    rig.pose[rig.joints.index("rh_MFJ4")] = -0.3
    rig.hear()
    return armed(rig)


@pytest.fixture
def without(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], None]:
    """Takes one check out of every list."""

    def take_out(name: str) -> None:
        left = lambda listed: tuple(check for check in listed if check.__name__ != name)  # noqa: E731
        for user, table in (("authority", "IDENTITY"), ("gate", "BEGUN")):
            monkeypatch.setattr(f"twin_daemon.gate.{user}.{table}", left(getattr(checks, table)))
        for table in ("ALLOWED", "MOTION"):
            kept = {verb: left(listed) for verb, listed in getattr(checks, table).items()}
            monkeypatch.setattr(f"twin_daemon.gate.gate.{table}", kept)

    return take_out


@pytest.mark.parametrize(("name", "verb"), SCENARIOS)
def test_a_check_refuses_what_nothing_else_refuses(
    name: str, verb: str, twin: TwinModel, without: Callable[[str], None]
) -> None:
    scenario = SCENARIOS[name, verb]
    answer = scenario(Rig(twin))
    check = next(
        c for c in (*checks.IDENTITY, *checks.ALLOWED[verb], *checks.MOTION.get(verb, ())) if c.__name__ == name
    )
    assert not answer["accepted"]
    assert answer["why"]
    assert answer["consequence"]
    assert check.__doc__ is None or answer["check"]
    without(name)
    bare = scenario(Rig(twin))
    assert bare["accepted"] or bare["check"] != answer["check"]


def test_every_check_of_every_request_has_such_a_scenario() -> None:
    needed = {
        (c.__name__, verb)
        for table in (checks.ALLOWED, checks.MOTION)
        for verb, listed in table.items()
        for c in listed
    }
    needed |= {(c.__name__, "arm") for c in checks.IDENTITY}
    assert needed - UNREACHED == set(SCENARIOS)


@pytest.mark.parametrize("verb", ["arm", "disarm", "beat", "release", "move", "trajectory", "target"])
@pytest.mark.parametrize("who", [None, NOBODY, EVE])
def test_whoever_may_not_command_gets_nothing_through(rig: Rig, verb: str, who: Any) -> None:
    armed(rig)
    body = {"move": {"targets": SMALL}, "target": {"targets": SMALL}, "trajectory": plan([[0.0], [0.3]])}.get(verb, {})
    answer = rig.ask(verb, who, **body)
    assert not answer["accepted"]
    assert answer["check"] in ("identity", "role")
    assert rig.turns(0.2) == []
    assert any(not entry["accepted"] for entry in rig.entries)


def test_anybody_may_stop_and_only_a_release_undoes_it(rig: Rig) -> None:
    rig.arm()
    rig.ask("move", targets={"rh_FFJ3": 1.0})
    rig.turns(0.3)
    assert rig.ask("stop", NOBODY, reason="smoke")["accepted"]
    rig.turns(0.1, beat=False)
    assert not rig.status["moving"]
    refused = rig.ask("arm", reason="x")
    assert refused["check"] == "stopped"
    assert "smoke" in refused["why"]
    assert not rig.ask("release", EVE, reason="x")["accepted"]
    assert rig.ask("release", reason="it was nothing")["accepted"]
    assert rig.ask("arm", ANN, reason="x")["accepted"]
