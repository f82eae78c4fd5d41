"""Where a motor of its own stands when a roll-out begins in the midst of a motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

_ELBOW = """<mujoco model="elbow"><compiler angle="radian"/><option timestep="0.001"/><worldbody><body name="link">
<joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5" {more}/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("key", "values", "within_rad"),
    [
        ("tendon_elasticity", {"stiffness": 6.0, "motor_share": 0.1}, 1e-3),
        ("tendon_elasticity", {"stiffness": 6.0, "motor_share": 0.05, "damping_share": 0.6}, 1e-3),
        ("backlash", {"gap": 0.05, "motor_share": 0.3}, 1e-3),
    ],
)
@pytest.mark.parametrize("more", ["", 'forcerange="-0.22 0.22"'])
def test_a_rollout_begun_on_a_steady_way_goes_on_as_the_whole_one(
    tmp_path: Path, key: str, values: dict[str, float], within_rad: float, more: str
) -> None:
    """Only where the joint is and how fast it turns is known there; its motor carries gravity, friction and damping."""
    path = tmp_path / "elbow.xml"
    path.write_text(_ELBOW.format(more=more))
    effect = EffectTerm(effect=key, target="elbow", values=values)
    twin = TwinModel.load(load_hand(model=path)).changed(Terms(effects=(effect,)))
    step_s, begun = 0.001, 900
    controls = (0.5 * step_s * np.arange(1500) - 0.3)[:, None]
    start = twin.initial_qpos(np.array([-0.3]), controls[0])
    column = twin.qpos_adr[0]
    whole = roll_out([twin.model], controls[None], start[None])[0][:, column]
    speed = np.zeros(twin.model.nv)
    speed[twin.dof_adr[0]] = (whole[begun + 1] - whole[begun - 1]) / (2.0 * step_s)
    there = twin.initial_qpos(whole[begun : begun + 1], controls[begun])
    rest = [
        roll_out([twin.model], controls[None, begun:], there[None], speed[None], loaded=loaded)[0][:, column]
        for loaded in (True, False)
    ]
    settled, unsettled = (float(np.abs(one - whole[begun:]).max()) for one in rest)
    assert settled < within_rad
    assert settled < unsettled
