"""A model that its author stepped by Runge-Kutta."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

_ARM = """<mujoco model="arm"><compiler angle="radian"/><option timestep="0.004" integrator="RK4"/><worldbody>
<body name="link"><joint name="elbow" axis="0 1 0" range="-2 2" damping="117" armature="1.47"/>
<geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="3"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="1690" forcerange="-1250 1250"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("coulomb_friction", {"friction": 16.9, "sticking": 0.0}),
        ("stribeck_friction", {"breakaway": 33.8, "velocity": 0.06}),
        ("backlash", {"gap": 0.02}),
        ("tendon_elasticity", {"stiffness": 5000.0}),
    ],
)
def test_what_is_stiff_does_not_run_away(tmp_path: Path, effect: str, values: dict[str, float]) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(_ARM)
    twin = TwinModel.load(
        load_hand(model=model), Terms(effects=(EffectTerm(effect=effect, target="elbow", values=values),))
    )
    data, angles = mujoco.MjData(twin.model), []
    for step in range(500):
        data.ctrl[0] = 0.5 * np.sin(2.0 * np.pi * step * twin.model.opt.timestep)
        mujoco.mj_step(twin.model, data)
        angles.append(data.qpos[twin.qpos_adr[0]])
    assert data.warning.number.sum() == 0
    assert 0.1 < np.ptp(angles) < 1.2
