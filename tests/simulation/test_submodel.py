"""A finger on its own moves as it does on the hand."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.simulation.made import FINGER, recorded
from twin_daemon.estimation.partition import restricted
from twin_daemon.hand import load_hand
from twin_daemon.simulation.alignment import align, predict
from twin_daemon.simulation.submodel import parts, submodel
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

INDEX = ("rh_FFJ1", "rh_FFJ2", "rh_FFJ3", "rh_FFJ4")
TERMS = Terms(
    parameters={"rh_FFJ3.damping": 0.2, "rh_FFJ0.kp": 3.0, "rh_LFJ3.damping": 0.3},
    effects=(
        EffectTerm(effect="sensor_offset", target="rh_FFJ3", values={}),
        EffectTerm(effect="sensor_offset", target="rh_LFJ3", values={}),
    ),
)


def test_the_parts_are_fingers_thumb_and_wrist(twin: TwinModel) -> None:
    found = {part.joints: part for part in parts(twin)}
    assert INDEX in found
    assert found[INDEX].trunk == ("rh_WRJ2", "rh_WRJ1")  # base first
    assert ("rh_WRJ1", "rh_WRJ2") in found
    assert sorted(j for joints in found for j in joints) == sorted(twin.joints)


@pytest.mark.parametrize("keep", [INDEX, INDEX[:3]], ids=["with abduction", "abduction welded"])
@pytest.mark.parametrize("terms", [Terms(), TERMS], ids=["nominal", "with terms"])
def test_a_finger_alone_is_within_a_milliradian_of_the_whole_hand(
    keep: tuple[str, ...], terms: Terms, twin: TwinModel, rng: np.random.Generator
) -> None:
    whole = twin.changed(terms)
    aligned = align(whole, recorded(whole, FINGER, rng))
    small = submodel(whole, keep, aligned.start_position)
    assert small.joints == keep
    assert small.model.nv == len(keep)
    columns = [whole.joints.index(name) for name in keep]
    gap = predict(small, restricted(aligned, small)) - predict(whole, aligned)[:, columns]
    assert np.abs(gap).max() < 1e-3


def test_terms_of_what_is_gone_are_gone(twin: TwinModel) -> None:
    small = submodel(twin.changed(TERMS), INDEX, np.zeros(len(twin.joints)))
    assert set(small.terms.parameters) == {"rh_FFJ3.damping", "rh_FFJ0.kp"}
    assert [term.target for term in small.terms.effects] == ["rh_FFJ3"]


def test_bodies_without_a_name_are_given_one_that_nobody_has(tmp_path: Path) -> None:
    link = '<body{0} pos="0 {1} 0"><joint name="j{1}" armature="0.01"/><geom size="0.02" mass="0.1"/></body>'
    links = link.format("", 0) + link.format(' name="body_1"', 1)
    servos = "".join(f'<position name="a{i}" joint="j{i}" kp="1"/>' for i in range(2))
    path = tmp_path / "unnamed.xml"
    path.write_text(f"<mujoco><worldbody>{links}</worldbody><actuator>{servos}</actuator></mujoco>")
    twin = TwinModel.load(load_hand(model=path))
    names = [twin.model.body(index).name for index in range(twin.model.nbody)]
    assert len(set(names)) == 3
    assert all(names)
    assert submodel(twin, {"j0"}, np.zeros(2)).joints == ("j0",)


def test_friction_creeps_in_a_part_as_in_the_whole(tmp_path: Path) -> None:
    """MuJoCo scales how fast a joint that friction holds creeps under a load by its inertia: in a part it has more."""
    link = (
        '<body name="{0}_link" pos="{1} 0 0"><joint name="{0}" axis="0 1 0" damping="0.02" armature="0.0004"'
        ' frictionloss="0.05"/><geom type="capsule" fromto="0 0 0 0.06 0 0" size="0.008" mass="0.05" contype="0"'
        ' conaffinity="0"/>'
    )
    names = ("base", "middle", "tip")
    links = "".join(link.format(name, 0.06 if i else 0.0) for i, name in enumerate(names))
    servos = "".join(f'<position name="{name}" joint="{name}" kp="20" kv="0.2"/>' for name in names if name != "middle")
    path = tmp_path / "chain.xml"
    path.write_text(
        f'<mujoco model="chain"><option timestep="0.002"/><worldbody>{links}{"</body>" * 3}</worldbody>'
        f"<actuator>{servos}</actuator></mujoco>"
    )
    whole = TwinModel.load(load_hand(model=path))
    part = submodel(whole, ("middle",), np.zeros(3))
    crept = []
    for twin in (whole, part):
        data, place = mujoco.MjData(twin.model), twin.qpos_adr[twin.joints.index("middle")]
        for _ in range(1000):
            mujoco.mj_step(twin.model, data)
        begin = float(data.qpos[place])
        for _ in range(1000):
            mujoco.mj_step(twin.model, data)
        crept.append(float(data.qpos[place]) - begin)
    assert crept[0] > 1e-4  # it does creep
    assert crept[1] == pytest.approx(crept[0], rel=0.1)


def test_a_tendon_without_a_name_goes_along(tmp_path: Path) -> None:
    link = (
        '<body pos="0.2 0 0"><joint name="{0}" axis="0 1 0"/><geom size="0.02" mass="0.1" contype="0" conaffinity="0"/>'
    )
    names = ("base", "middle", "tip")
    servos = "".join(f'<position name="{name}" joint="{name}" kp="5"/>' for name in names)
    path = tmp_path / "tied.xml"
    path.write_text(
        f'<mujoco model="tied"><worldbody>{"".join(map(link.format, names))}{"</body>" * 3}</worldbody><tendon>'
        '<fixed stiffness="1"><joint joint="middle" coef="1"/><joint joint="tip" coef="-1"/></fixed></tendon>'
        f"<actuator>{servos}</actuator></mujoco>"
    )
    whole = TwinModel.load(load_hand(model=path))
    assert submodel(whole, ("middle", "tip"), np.zeros(3)).model.ntendon == 1


def test_a_value_of_a_joint_that_is_gone_goes_though_a_body_bears_its_name(tmp_path: Path) -> None:
    link = '<body name="{1}" pos="0.1 0 0"><joint name="{0}" axis="0 1 0"/><geom size="0.02" mass="0.1"/>'
    path = tmp_path / "named.xml"
    path.write_text(
        f'<mujoco model="named"><worldbody>{link.format("roll", "gripper")}{link.format("gripper", "jaw")}'
        '</body></body></worldbody><actuator><position name="roll" joint="roll" kp="5"/>'
        '<position name="gripper" joint="gripper" kp="5"/></actuator></mujoco>'
    )
    twin = TwinModel.load(load_hand(model=path))
    changed = twin.changed(
        Terms(parameters={"gripper.kp": 3.0, "gripper.damping": 0.1, "gripper.mass": 0.2, "roll.kp": 4.0})
    )
    part = submodel(changed, ("roll",), np.zeros(2))
    assert part.terms.parameters == {"gripper.mass": 0.2, "roll.kp": 4.0}


ARM = (
    '<mujoco model="arm"><compiler boundmass="1e-6"/><worldbody>'
    '<body name="upper"><joint name="shoulder" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"'
    ' mass="0.3"/><body name="lower" pos="0.2 0 0"><joint name="elbow" axis="0 1 0"/>'
    '<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2"/></body></body></worldbody>'
    '<actuator><position name="shoulder" joint="shoulder" kp="5"/><position name="elbow" joint="elbow" kp="5"/>'
    "</actuator></mujoco>"
)


def _needed_to_hold(model: mujoco.MjModel) -> float:
    """N m that the first joint needs to hold the arm level."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(data.qfrc_bias[0])


@pytest.mark.parametrize("body", ["upper", "lower"])
def test_each_body_of_a_part_keeps_its_mass_where_one_is_changed(body: str, tmp_path: Path) -> None:
    """Bodies that are welded together are one to whoever changes none of them."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM)
    whole = TwinModel.load(load_hand(model=path))
    heavier = Terms(parameters={f"{body}.mass": 0.5})
    for keep in (("shoulder",), ("shoulder", "elbow")):
        part = submodel(whole.changed(heavier), keep, np.zeros(2))
        assert part.terms == heavier
        assert _needed_to_hold(part.model) == pytest.approx(_needed_to_hold(whole.changed(heavier).model))
        searched = submodel(whole, keep, np.zeros(2), bodies=True).changed(heavier)
        assert _needed_to_hold(searched.model) == pytest.approx(_needed_to_hold(whole.changed(heavier).model))
