"""Play of a servo whose derivative gain acts on the joint itself, against its law in small explicit steps."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin_daemon.errors import BadInput
from twin_daemon.hand import load_hand
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

_KP, _KV, _LIMIT, _INERTIA = 2000.0, 200.0, 12.0, 0.2
_STEP_S, _FINER = 0.002, 40


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> TwinModel:
    path = tmp_path_factory.mktemp("models") / "arm.xml"
    path.write_text(
        f'<mujoco model="arm"><option timestep="{_STEP_S}" integrator="implicitfast" gravity="0 0 0"/><worldbody><body>'
        f'<inertial mass="1" pos="0 0 0" diaginertia=".1 .1 .1"/><joint name="j" axis="0 0 1" armature="0.1"/></body>'
        f'</worldbody><actuator><general name="j" joint="j" gainprm="{_KP}" biastype="affine" '
        f'biasprm="0 -{_KP} -{_KV}" ctrlrange="-2 2" forcerange="-{_LIMIT} {_LIMIT}"/></actuator></mujoco>'
    )
    return TwinModel.load(load_hand(model=path))


def _commands() -> np.ndarray:
    """(T,) rad: slow reversals within a few gaps, then a step at which the servo comes to its limit."""
    time_s = np.arange(0.0, 4.0, _STEP_S)
    return 0.02 * np.sin(2 * np.pi * 0.7 * time_s) + np.clip(2.0 * (time_s - 2.5), 0.0, 0.5)


def _by_hand(commands: np.ndarray, gap: float) -> np.ndarray:
    """(T + 1,) rad of the joint: the servo's stiffness behind a gap, its brake before it, one limit for both."""
    angle = speed = 0.0
    step_s, out = _STEP_S / _FINER, [0.0]
    for target in commands:
        for _ in range(_FINER):
            error = target - angle
            beyond = np.sign(error) * max(abs(error) - 0.5 * gap, 0.0)
            speed += step_s * float(np.clip(_KP * beyond - _KV * speed, -_LIMIT, _LIMIT)) / _INERTIA
            angle += step_s * speed
        out.append(angle)
    return np.array(out)


@pytest.mark.parametrize("gap", [0.003, 0.01])
def test_it_pulls_behind_the_gap_brakes_within_and_keeps_its_limit(arm: TwinModel, gap: float) -> None:
    commands = _commands()
    values = {"gap": gap, "braked": 1.0}
    twin = arm.changed(Terms(effects=(EffectTerm(effect="backlash", target="j", values=values),)))
    moved = roll_out([twin.model], commands[None, :, None], twin.initial_qpos(np.zeros(1), commands[:1])[None])[0]
    wanted, plain = _by_hand(commands, gap), _by_hand(commands, 0.0)
    assert np.ptp(wanted - plain) > 0.8 * gap  # it shows
    # the step of 2 ms is off by as much without any play
    own = roll_out([arm.model], commands[None, :, None], arm.initial_qpos(np.zeros(1), commands[:1])[None])[0]
    step_error = np.abs(own[:, arm.qpos_adr[0]] - plain).max()
    assert np.abs(moved[:, twin.qpos_adr[0]] - wanted).max() < step_error + 0.05 * gap + 2e-4


def test_without_a_derivative_gain_it_is_a_servo_that_is_silent_within_the_gap(arm: TwinModel) -> None:
    spec = arm.nominal.copy()
    spec.actuator("j").biasprm[2] = 0.0
    spec.joint("j").damping[0] = _KV
    plain = TwinModel(arm.hand, spec, Terms())
    rows = []
    for effect, values in (("backlash", {"gap": 0.01, "braked": 1.0}), ("dead_zone", {"band": 0.005})):
        twin = plain.changed(Terms(effects=(EffectTerm(effect=effect, target="j", values=values),)))
        rows.append(roll_out([twin.model], _commands()[None, :, None], twin.initial_qpos(np.zeros(1))[None])[0])
    np.testing.assert_array_equal(*rows)


def test_it_takes_no_command_of_its_own_and_exports_as_plain_mjcf(arm: TwinModel) -> None:
    values = {"gap": 0.01, "braked": 1.0}
    twin = arm.changed(Terms(effects=(EffectTerm(effect="backlash", target="j", values=values),)))
    assert twin.model.nu == arm.model.nu
    exported = mujoco.MjModel.from_xml_string(twin.mjcf())
    start = twin.initial_qpos(np.zeros(1))[None]
    moved = [roll_out([model], _commands()[None, :, None], start)[0] for model in (twin.model, exported)]
    np.testing.assert_allclose(*moved, rtol=0, atol=1e-9)


def test_there_is_no_room_for_a_silent_servo_beside_it(arm: TwinModel) -> None:
    both = (("backlash", {"gap": 0.01, "braked": 1.0}), ("dead_zone", {"band": 0.01}))
    effects = tuple(EffectTerm(effect=key, target="j", values=values) for key, values in both)
    with pytest.raises(BadInput, match="no room for both"):
        arm.changed(Terms(effects=effects))
