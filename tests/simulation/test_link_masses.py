"""What heavier links do to the joints that carry them is what inverse dynamics says of them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin_daemon.estimation.partition import combinations
from twin_daemon.estimation.thresholds import LEFT_OUT_FLOORS
from twin_daemon.hand import load_hand
from twin_daemon.simulation.link_masses import LinkPaths
from twin_daemon.simulation.prescribed import Motion
from twin_daemon.simulation.twin import TwinModel

ARM = """
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="cart"><joint name="rail" type="slide" axis="1 0 0.2"/>
      <inertial pos="0.01 0 0.02" mass="2" diaginertia="0.01 0.02 0.03"/>
      <body name="upper" pos="0 0 0.1"><joint name="shoulder" axis="0 1 0"/>
        <inertial pos="0.2 0.01 0" mass="1" diaginertia="0.01 0.02 0.03" quat="0.9 0.1 0.3 0.2"/>
        <body name="lower" pos="0.4 0 0"><joint name="elbow" axis="0 0.3 1"/>
          <inertial pos="0.1 0 0.05" mass="0.5" diaginertia="0.004 0.006 0.005"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="a" joint="rail" kp="100"/><position name="b" joint="shoulder" kp="100"/>
    <position name="c" joint="elbow" kp="100"/>
  </actuator>
</mujoco>
"""
JOINTS = ("rail", "shoulder", "elbow")
SHARE = 0.01


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> TwinModel:
    path = tmp_path_factory.mktemp("arm") / "arm.xml"
    path.write_text(ARM)
    return TwinModel.load(load_hand(model=path))


@pytest.fixture(scope="module")
def motion(arm: TwinModel) -> Motion:
    time_s = np.arange(0.0, 2.0, 0.002)
    rate, phase = np.array([3.0, 5.0, 7.0]), np.array([0.0, 1.0, 2.0])
    turn = rate * time_s[:, None] + phase
    assert sorted(arm.joints) == sorted(JOINTS)
    return Motion(time_s, np.sin(turn), rate * np.cos(turn), -(rate**2) * np.sin(turn))


def needed(arm: TwinModel, model: mujoco.MjModel, motion: Motion) -> np.ndarray:
    """(m, nv) torques of inverse dynamics."""
    data, out = mujoco.MjData(model), []
    for row in range(len(motion.time_s)):
        data.qpos[arm.qpos_adr], data.qvel[arm.dof_adr], data.qacc[arm.dof_adr] = (
            each[row] for each in (motion.position, motion.velocity, motion.acceleration)
        )
        mujoco.mj_inverse(model, data)
        out.append(data.qfrc_inverse.copy())
    return np.array(out)


@pytest.mark.parametrize("body", ["cart", "upper", "lower"])
@pytest.mark.parametrize("what", range(5), ids=["mass", "centre_x", "centre_y", "centre_z", "inertia"])
def test_each_share_gives_the_torque_of_inverse_dynamics(arm: TwinModel, motion: Motion, body: str, what: int) -> None:
    number = arm.model.body(body).id
    changed = arm.model.__copy__()
    if what == 0:
        changed.body_mass[number] *= 1.0 + SHARE
    elif what == 4:
        changed.body_inertia[number] *= 1.0 + SHARE
    else:
        turned = np.empty(9)
        mujoco.mju_quat2Mat(turned, arm.model.body_iquat[number])
        way = turned.reshape(3, 3)[:, what - 1]
        changed.body_ipos[number] += SHARE * np.linalg.norm(arm.model.body_ipos[number]) * way
    asked = needed(arm, changed, motion) - needed(arm, arm.model, motion)
    columns = LinkPaths.along(arm, motion).torques([arm.model.joint(i).name for i in range(3)], SHARE)
    said = columns[:, :, 5 * (number - 1) + what]
    inner = slice(5, -5)  # derivatives at the ends are one-sided
    assert np.abs(asked - said)[inner].max() < 0.02 * np.abs(asked).max() + 1e-9


def test_combinations_leave_less_out_than_the_sensors_show(arm: TwinModel, motion: Motion) -> None:
    torque = LinkPaths.along(arm, motion).torques(("shoulder",), SHARE)
    least = np.array([0.02])
    chosen = combinations([torque], least)
    left = torque @ (np.eye(torque.shape[2]) - chosen @ chosen.T) / least[:, None]
    assert 0 < chosen.shape[1] < torque.shape[2]
    assert (left**2).sum(axis=2).mean() <= LEFT_OUT_FLOORS
    assert combinations([torque], 1e6 * least).shape[1] == 0
