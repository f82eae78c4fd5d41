"""A load that all joints of a chain carry, and that is far heavier than the one that is tried first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.diagnosis.conftest import said_of_case
from tests.simulation.made import Motion, recorded
from twin_daemon.diagnosis.everywhere import behind_all
from twin_daemon.diagnosis.group import at_nominal, look
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.shared import SharedSearch
from twin_daemon.diagnosis.shared_cause import SharedCause, shared_causes
from twin_daemon.diagnosis.shared_pair import SharedPair
from twin_daemon.effects import LIBRARY
from twin_daemon.estimation.partition import Reduced, Reduction
from twin_daemon.hand import load_hand
from twin_daemon.places import HAND, ROBOT
from twin_daemon.simulation.alignment import align
from twin_daemon.simulation.submodel import drive_groups
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

JOINTS = ("shoulder", "elbow", "wrist")
LOAD_KG = 1.6

_LINK = """<body name="{0}_link" pos="{1} 0 0"><joint name="{0}" axis="0 1 0" range="-2 2" damping="2" armature="0.3"/>
<geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1" contype="0" conaffinity="0"/>"""
_SERVO = '<position name="{0}" joint="{0}" kp="{1}" kv="{2}" ctrlrange="-2 2" forcerange="-30 30"/>'


_ROLL = """<body name="roll_link" pos="0.3 0 0">
<joint name="roll" axis="1 0 0" range="-2 2" damping="2" armature="0.3"/>
<geom type="capsule" fromto="0 0.001 0 0.3 0.001 0" size="0.03" mass="0.3" contype="0" conaffinity="0"/>{0}</body>"""


def _arm(folder: Path, *beside: str, end: str = "") -> TwinModel:
    """An arm, what is at its end, and single joints beside it that carry none of it."""
    links = "".join(_LINK.format(name, 0.3 if i else 0.0) for i, name in enumerate(JOINTS))
    links += end + "</body>" * len(JOINTS)
    links += "".join(_LINK.format(name, -1.0) + "</body>" for name in beside)
    strengths = dict(zip((*JOINTS, *beside), (2000, 1000, 500, *(1000 for _ in beside)), strict=True))
    strengths |= {"roll": 50} if end else {}
    servos = "".join(_SERVO.format(name, kp, 0.05 * kp) for name, kp in strengths.items())
    path = folder / "arm.xml"
    path.write_text(
        '<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>'
        f"<worldbody>{links}</worldbody><actuator>{servos}</actuator></mujoco>"
    )
    return TwinModel.load(load_hand(model=path))


def _groups(
    twin: TwinModel, *hidden: EffectTerm, noise_rad: float = 3e-5, plant: TwinModel | None = None
) -> tuple[Reduction, list[tuple[Reduced, PartFit]]]:
    """(the motion of an arm with hidden loads, or of another one, each of its joints as a group of its own)."""
    times = [0.0, 0.5, 1.0, 2.0, 2.5, 3.5, 4.0, 5.0, 6.0]
    moves: Motion = {
        joint: (times, [0.0, 0.0, *(0.5 * (-1) ** (i // (n + 1)) for i in range(6)), 0.0])
        for n, joint in enumerate(sorted(twin.joints, key=lambda joint: (*JOINTS, joint).index(joint)))
    }
    plant = plant or twin.changed(Terms(effects=hidden))
    made = align(twin, recorded(plant, moves, np.random.default_rng(3), seconds=6.0, noise_rad=noise_rad))
    reduction = Reduction(twin, [made], [made])
    cut = [reduction.of(twin, group, group.joints) for group in drive_groups(twin)]
    return reduction, [at_nominal(reduced) for reduced in cut if reduced is not None]


def _search(twin: TwinModel, *hidden: EffectTerm, noise_rad: float = 3e-5) -> SharedSearch:
    reduction, groups = _groups(twin, *hidden, noise_rad=noise_rad)
    return SharedSearch(twin, reduction, groups)


def test_a_load_that_a_light_one_says_too_much_of_begins_at_less(tmp_path: Path) -> None:
    """A servo that it brings to its limit of torque falls behind out of proportion."""
    search = _search(_arm(tmp_path), EffectTerm(effect="payload", target="elbow", values={"mass": LOAD_KG, "at": 1.0}))
    cause = SharedCause(LIBRARY["payload"], "elbow")
    (begun,) = search.begun(cause)
    nothing = search.at(cause, {"mass": 0.0, "at": 1.0})
    assert begun.cost < 0.2 * nothing.cost
    assert begun.values["mass"] > 0.5 * LOAD_KG


def test_a_share_that_all_joints_have_more_of_is_fitted_to_its_end(tmp_path: Path) -> None:
    """It has no typical value, and is far beyond where it begins."""
    cold = EffectTerm(effect="viscous_friction", target=ROBOT, values={"damping": 0.0, "share": 6.0})
    search = _search(_arm(tmp_path), cold)
    cause = SharedCause(LIBRARY["viscous_friction"], ROBOT)
    (begun,) = search.begun(cause)
    found, _ = search.fitted(begun)
    assert found.values["share"] == pytest.approx(6.0, rel=0.1)
    assert found.cost < 0.1 * begun.cost


def test_what_all_servos_have_begins_where_the_few_that_show_it_most_take_it(tmp_path: Path) -> None:
    """And ends where a fit from its own starts to all of them ends."""
    late = EffectTerm(effect="command_delay", target=ROBOT, values={"delay": 0.03})
    twin = _arm(tmp_path, "beside", "behind", "below")
    search = _search(twin, late)
    cause = SharedCause(LIBRARY["command_delay"], ROBOT)
    (begun,) = search.begun(cause)
    assert begun.near
    assert len(begun.rows) == len(search.at(cause, {"delay": 0.01}).rows), "all groups"
    assert begun.values["delay"] == pytest.approx(0.03, rel=0.05)
    found = search.fitted(begun)[0]
    apart = search.fitted(search.at(cause, {"delay": 0.01}))[0]
    assert found.values["delay"] == pytest.approx(apart.values["delay"], rel=0.01)
    assert found.cost == pytest.approx(apart.cost, rel=0.02)


def test_a_cause_comes_near_another_or_does_not(tmp_path: Path) -> None:
    twin = _arm(tmp_path)
    load_term = EffectTerm(effect="payload", target="wrist", values={"mass": 0.1, "at": 0.5})
    search = _search(twin, load_term, noise_rad=1e-4)
    load, late = SharedCause(LIBRARY["payload"], "wrist"), SharedCause(LIBRARY["command_delay"], ROBOT)
    assert search.best([late], 0) is None
    assert search.nearly_as_good([load])
    assert search.best([load], 0) is not None
    assert not search.nearly_as_good([late])


def test_a_load_is_looked_for_where_those_feel_it_that_leave_much(tmp_path: Path) -> None:
    """A joint that does not carry it may be looked at as well, for the little that it leaves."""
    twin = _arm(tmp_path, "beside")
    load = EffectTerm(effect="payload", target="wrist", values={"mass": 0.1, "at": 0.5})
    reduction, begun = _groups(twin, load, noise_rad=1e-4)
    groups = [look(reduced) if "beside" in part.joints else (reduced, part) for reduced, part in begun]
    found, _ = behind_all(twin, reduction, groups, 2 * len(groups), 0, lambda _: None)
    assert found is not None
    assert found.finding.name == "payload:wrist"
    assert found.finding.values["mass"] == pytest.approx(0.1, rel=0.2)
    assert {joint for _, part in found.looked_at for joint in part.joints} == set(JOINTS)


def test_a_load_beside_the_line_of_a_link_is_one(tmp_path: Path) -> None:
    """On the line it would turn the joint a little, and it does not: it is on the axis, 2 mm beside the line."""
    twin = _arm(tmp_path, end=_ROLL.format(""))
    load = '<geom type="sphere" size="0.01" mass="0.3" pos="0.3 0 0" contype="0" conaffinity="0"/>'
    (tmp_path / "plant").mkdir()
    plant = _arm(tmp_path / "plant", end=_ROLL.format(load))
    reduction, begun = _groups(twin, noise_rad=1e-4, plant=plant)
    groups = [look(*one) for one in begun]
    found, _ = behind_all(twin, reduction, groups, len(groups), 0, lambda _: None)
    assert found is not None
    assert found.finding.name == "payload:roll"
    assert found.finding.values["mass"] == pytest.approx(0.3, rel=0.3)
    there = twin.changed(found.terms).model.body("roll_payload").pos
    assert there[1] == pytest.approx(0.0, abs=5e-4)  # its weight turns the joint by that
    assert there[2] == pytest.approx(0.0, abs=2e-3)


def test_a_pair_keeps_the_values_of_its_two_loads_apart(tmp_path: Path) -> None:
    """Both may have values of one name."""
    twin = _arm(tmp_path)
    pair = SharedPair((SharedCause(LIBRARY["payload"], "wrist"), SharedCause(LIBRARY["payload"], "elbow")))
    values = pair.accepted(pair.joined({"mass": 0.3}, {"mass": 1e6, "at": 0.5}))
    heaviest = pair.parameter("1.mass").limits[1]
    assert [pair.values_of(part, values) for part in pair.parts] == [
        {"mass": 0.3, "at": 1.0, "across_1": 0.0, "across_2": 0.0},
        {"mass": heaviest, "at": 0.5, "across_1": 0.0, "across_2": 0.0},
    ]
    terms = pair.terms(twin, values).effects
    assert {(term.target, term.values["mass"]) for term in terms} == {("wrist", 0.3), ("elbow", heaviest)}
    nothing = pair.terms(twin, pair.neutral()).effects
    assert {term.values["mass"] for term in nothing} == {0.0}


@pytest.mark.slow
def test_two_loads_at_once_are_both_found_at_their_places(tmp_path: Path) -> None:
    """Each of them alone does some of the other one's work, so that it is too large, and at another place."""
    twin = _arm(tmp_path)
    load = EffectTerm(effect="payload", target="elbow", values={"mass": 0.2, "at": 0.5})
    tilt = EffectTerm(effect="gravity_tilt", target=HAND, values={"about_x": 0.0, "about_y": 0.08})
    search = _search(twin, load, tilt, noise_rad=1e-4)
    found = search.best(shared_causes(twin, [[joint] for joint in JOINTS], everywhere=False), 0)
    assert found is not None
    values = {one.name: one.values for one in found.findings}
    assert set(values) == {"payload:elbow", "gravity_tilt:hand"}
    assert values["payload:elbow"]["mass"] == pytest.approx(0.2, rel=0.3)
    assert values["gravity_tilt:hand"]["about_y"] == pytest.approx(0.08, rel=0.1)
    assert all(one.parameters.keys() <= one.values.keys() for one in found.findings)


@pytest.mark.slow
def test_a_load_is_not_all_where_a_value_has_to_go_far_beside_it(tmp_path: Path) -> None:
    """A ripple at an arm's base, beside a load at its elbow, would else be taken for three times the base's inertia."""
    said = said_of_case(4398, tmp_path)
    assert {one["target"]: one["effect"] for one in said["findings"]} == {"elbow": "payload", "pan": "torque_ripple"}
    assert said["verdict"] == "explained"


@pytest.mark.slow
def test_a_tilt_is_found_where_one_law_stands_in_for_it_and_for_an_offset(tmp_path: Path) -> None:
    """A tilt and an offset at one finger look most like a coupling there, beside which no tilt explains the others."""
    said = said_of_case(4206, tmp_path)
    found = {one["target"]: one["effect"] for one in said["findings"]}
    assert found == {"F2J2": "sensor_offset", "hand": "gravity_tilt"}
    assert said["verdict"] == "explained"


@pytest.mark.slow
def test_a_load_on_an_arm_that_is_tilted_is_told_from_the_tilt(tmp_path: Path) -> None:
    said = said_of_case(4990, tmp_path)
    assert {one["effect"] for one in said["findings"]} == {"payload", "gravity_tilt"}
    assert said["verdict"] in ("explained", "ambiguous")


@pytest.mark.slow
def test_a_tilt_is_found_beside_what_one_joint_has_of_its_own(tmp_path: Path) -> None:
    """Dry friction that bends first has nearly all of a finger's error, and no tilt explains anything of it."""
    said = said_of_case(5118, tmp_path)
    assert {one["target"]: one["effect"] for one in said["findings"]} == {"F1J1": "hysteresis", "hand": "gravity_tilt"}
    assert said["verdict"] in ("explained", "ambiguous")
