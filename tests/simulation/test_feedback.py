"""Roll-outs whose torque follows from the state are those of MuJoCo, where MuJoCo has the same torque."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin_daemon.simulation.feedback import roll_out_with_feedback
from twin_daemon.simulation.rollout import initial_state, roll_out

_XML = """<mujoco><option timestep="0.002" integrator="implicitfast"/><worldbody><body><joint name="j" axis="0 1 0"
damping="0.2" armature="0.01" frictionloss="0.02" {}/><geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".2"/>
</body></worldbody><actuator><position joint="j" kp="5"/></actuator></mujoco>"""
STEPS = np.array([400, 400, 250])


def _controls() -> np.ndarray:
    return np.sin(np.linspace(0.0, 6.0, 400))[None, :, None]


def _fed(model: mujoco.MjModel, stiffness: float) -> np.ndarray:
    controls = _controls()
    inputs = np.concatenate([controls, np.zeros_like(controls)], axis=2)
    start = initial_state(model, mujoco.MjData(model), np.zeros(1), np.array([0.3]), np.zeros(1), None, loaded=False)
    return roll_out_with_feedback(
        [model] * 3,
        np.repeat(start[None], 3, axis=0),
        inputs,
        np.zeros(3, int),
        STEPS,
        lambda step, qpos, qvel, ctrl: -stiffness * qpos,
    )


def test_without_a_torque_it_is_the_plain_roll_out() -> None:
    model = mujoco.MjModel.from_xml_string(_XML.format(""))
    fed = _fed(model, 0.0)
    plain = roll_out([model], _controls(), np.array([[0.3]]))
    assert np.array_equal(fed[0], plain[0])
    assert np.array_equal(fed[2, : STEPS[2] + 1], plain[0, : STEPS[2] + 1])
    assert np.isnan(fed[2, STEPS[2] + 1 :]).all()


def test_a_spring_by_feedback_is_a_spring() -> None:
    bare, sprung = (mujoco.MjModel.from_xml_string(_XML.format(text)) for text in ("", 'stiffness="2"'))
    fed = _fed(bare, 2.0)
    plain = roll_out([sprung], _controls(), np.array([[0.3]]))
    assert np.abs(fed[0] - plain[0]).max() < 1e-9


def test_what_diverges_is_not_a_number_and_leaves_the_others_alone() -> None:
    model = mujoco.MjModel.from_xml_string(_XML.format(""))
    controls = _controls()
    inputs = np.concatenate([controls, np.zeros_like(controls)], axis=2)
    start = initial_state(model, mujoco.MjData(model), np.zeros(1), np.array([0.3]), np.zeros(1), None, loaded=False)
    found = roll_out_with_feedback(
        [model] * 2,
        np.repeat(start[None], 2, axis=0),
        inputs,
        np.zeros(2, int),
        np.array([400, 400]),
        lambda step, qpos, qvel, ctrl: np.array([[0.0], [1e12]]) * np.sign(qpos),
    )
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


def test_simulations_stand_longest_first() -> None:
    model = mujoco.MjModel.from_xml_string(_XML.format(""))
    start = initial_state(model, mujoco.MjData(model), np.zeros(1), np.zeros(1), np.zeros(1), None, loaded=False)
    with pytest.raises(ValueError, match="longest first"):
        roll_out_with_feedback(
            [model] * 2, np.stack([start, start]), np.zeros((1, 5, 2)), np.zeros(2, int), np.array([3, 5]),
            lambda step, qpos, qvel, ctrl: 0.0 * qpos,
        )  # fmt: skip
