"""Friction that grows with the load: along a slide instead of about a hinge, and at the start of a roll-out."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

STEPS, STEP_S = 5000, 1e-3
MODEL = f"""
<mujoco model="lift"><option timestep="{STEP_S}"/>
  <worldbody><body pos="0 0 1">
    <joint name="z" type="slide" axis="0 {{tilt}} 1" range="-0.5 0.5" damping="5" frictionloss="0.3" armature="0.2"/>
    <geom type="box" size=".05 .05 .05" mass="1"/>
  </body></worldbody>
  <actuator><position name="z" joint="z" kp="400" ctrlrange="-0.5 0.5"/></actuator>
</mujoco>"""


def _lift(folder: Path, tilt: float) -> TwinModel:
    path = folder / "lift.xml"
    path.write_text(MODEL.format(tilt=tilt))
    return TwinModel.load(load_hand(model=path))


def _moved(model: mujoco.MjModel, controls: np.ndarray) -> np.ndarray:
    start = mujoco.MjData(model).qpos[None]
    return roll_out([model], controls[None], start)[0][1:, model.joint("z").qposadr[0]]


def _by_the_law(model: mujoco.MjModel, controls: np.ndarray, coefficient: float) -> np.ndarray:
    """The slide with its own friction set anew before each step, by the force of its servo."""
    data, dof = mujoco.MjData(model), model.joint("z").dofadr[0]
    own, moved = float(model.dof_frictionloss[dof]), np.zeros(len(controls))
    for step, control in enumerate(controls):
        data.ctrl[:] = control
        model.dof_frictionloss[dof] = own + coefficient * abs(data.actuator_force[0])
        mujoco.mj_step(model, data)
        moved[step] = data.qpos[0]
    model.dof_frictionloss[dof] = own
    return moved


@pytest.mark.parametrize(("coefficient", "share"), [(0.02, 0.06), (0.05, 0.06), (0.2, 0.06), (0.5, 0.12)])
@pytest.mark.parametrize("tilt", [0.0, 0.5])
def test_the_brake_of_a_slide_takes_its_share_of_the_force(
    tmp_path: Path, coefficient: float, share: float, tilt: float
) -> None:
    """Of what load friction does to a lift that bears its weight the brake does all but a small part."""
    time_s = STEP_S * np.arange(STEPS)
    controls = (0.15 * np.sin(2.0 * time_s) + 0.05 * np.sin(5.1 * time_s))[:, None]
    lift = _lift(tmp_path, tilt)
    values = {"coefficient": coefficient, "creep": 1.0}
    braked = lift.changed(Terms(effects=(EffectTerm(effect="load_friction", target="z", values=values),)))
    without = _moved(lift.model, controls)
    law = _by_the_law(lift.model, controls, coefficient)
    off = np.sqrt(np.mean((_moved(braked.model, controls) - law) ** 2))
    assert off < share * np.sqrt(np.mean((law - without) ** 2))


def test_a_brake_that_does_not_rub_leaves_the_slide_alone(tmp_path: Path) -> None:
    controls = np.repeat([0.0, 0.1, -0.2, 0.15], STEPS // 4)[:, None]
    lift = _lift(tmp_path, 0.0)
    term = EffectTerm(effect="load_friction", target="z", values={"coefficient": 0.0, "creep": 0.0})
    free = _moved(lift.changed(Terms(effects=(term,))).model, controls)
    assert np.sqrt(np.mean((free - _moved(lift.model, controls)) ** 2)) < 2e-3


ELBOW = """<mujoco model="elbow"><compiler angle="radian"/><option timestep="0.004"/><worldbody><body name="link">
<joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.0135" armature="0.001"/>
<geom type="capsule" fromto="0 0 0 0.03 0 0" size="0.005" mass="0.005" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="0.09" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""


def test_a_brake_that_a_rollout_begins_with_takes_nothing_off_the_speed(tmp_path: Path) -> None:
    """A shoe that touched both of its plates would be jammed, and would brake without any load."""
    path = tmp_path / "elbow.xml"
    path.write_text(ELBOW)
    elbow = TwinModel.load(load_hand(model=path))
    term = EffectTerm(effect="load_friction", target="elbow", values={"coefficient": 0.0, "creep": 0.0})
    controls, moved = np.full((20, 1), 0.02), []
    for twin in (elbow, elbow.changed(Terms(effects=(term,)))):
        start, speed = twin.initial_qpos(np.zeros(1), controls[0]), np.zeros(twin.model.nv)
        speed[twin.dof_adr[0]] = -0.16
        moved.append(roll_out([twin.model], controls[None], start[None], speed[None])[0][:, twin.qpos_adr[0]])
    assert np.abs(moved[1] - moved[0]).max() < 2e-5
