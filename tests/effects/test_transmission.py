"""A motor behind a transmission that gives, against figures worked out by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.effects.conftest import loaded_finger, move
from twin_daemon.hand import load_hand
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

_ELBOW = """<mujoco model="elbow"><compiler angle="radian"/><option timestep="0.002" gravity="0 0 0"/><worldbody>
<body name="link"><joint name="elbow" axis="0 1 0" range="-1.5 1.5" damping="0.2" armature="0.004"/>
<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
<actuator><position name="elbow" joint="elbow" kp="4" ctrlrange="-1.5 1.5"/></actuator></mujoco>"""


def _damped(damping: float):
    """An edit of a model: without gravity and dry friction, its joints damped by so much, N m s/rad."""

    def edit(spec) -> None:
        spec.option.gravity = np.zeros(3)
        for joint in spec.joints:
            joint.frictionloss, joint.damping = 0.0, np.array([damping, 0.0, 0.0])

    return edit


@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_what_brakes_the_motor_does_not_stretch_the_tendon(share: float):
    """On a steady way the servo turns against all of the damping, the tendon against the joint's alone."""
    stiffness, speed, damping = 12.0, 0.4, 0.5
    finger = loaded_finger(_damped(damping))
    step_s, servo = finger.model.opt.timestep, finger.actuators.index("rh_FFJ3")
    controls = np.zeros((1500, len(finger.actuators)))
    controls[:, servo] = speed * step_s * np.arange(1, 1501)
    values = {"stiffness": stiffness, "motor_share": 0.02, "damping_share": share}
    twin = finger.changed(Terms(effects=(EffectTerm(effect="tendon_elasticity", target="rh_FFJ3", values=values),)))
    found = move(twin, controls)[-1, finger.joints.index("rh_FFJ3")]
    lag = speed * damping * (1.0 / 10.0 + (1.0 - share) / stiffness)
    assert controls[-1, servo] - found == pytest.approx(lag, abs=2.0 * speed * step_s)


@pytest.mark.parametrize(("step_s", "within_rad"), [(0.0005, 5e-4), (0.002, 2e-3)])
def test_a_light_motor_that_is_braked_follows_its_own_equation(tmp_path: Path, step_s: float, within_rad: float):
    """Against its motion and the joint's in small steps: two masses, a servo on the one, a spring between them."""
    path = tmp_path / "elbow.xml"
    path.write_text(_ELBOW)
    stiffness, share, braked = 6.0, 0.05, 0.6
    values = {"stiffness": stiffness, "motor_share": share, "damping_share": braked}
    elastic = Terms(effects=(EffectTerm(effect="tendon_elasticity", target="elbow", values=values),))
    twin = TwinModel.load(load_hand(model=path)).changed(elastic).at_step(step_s)
    controls = np.zeros((round(0.8 / step_s), 1))
    controls[len(controls) // 8 :] = 0.5
    found = move(twin, controls)[:, 0]

    inertia = float(TwinModel.load(load_hand(model=path)).model.dof_M0[0])
    armature, damping, loss = share * 0.004, 0.2, 0.002 * stiffness
    own = damping * armature / inertia
    brake = braked * (damping - own)
    q, v, m, w, expected, fine = 0.0, 0.0, 0.0, 0.0, [0.0], 2e-5
    for command in controls[:, 0].tolist():
        for _ in range(round(step_s / fine)):
            link = stiffness * (m - q) + loss * (w - v)
            w += fine * (4.0 * (command - m) - (own + brake) * w - link) / armature
            v += fine * (link - (damping - own - brake) * v) / (inertia - armature)
            m, q = m + fine * w, q + fine * v
        expected.append(q)
    assert float(np.sqrt(np.mean((found - expected) ** 2))) < within_rad
