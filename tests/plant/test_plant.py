"""The plant as a machine: the nominal hand is MuJoCo's own, seeds repeat, sensors are coarse, errors speak."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin_daemon.errors import BadInput, TwinError
from twin_daemon.hand import Hand, load_hand
from twin_daemon.plant import HIDDEN, Plant, parse_hidden

from .conftest import FF3, SHARED


def wave(plant: Plant, seconds: float = 1.0) -> np.ndarray:
    """(n, j) measured rad while two commands swing."""
    seen = []
    for tick in range(int(seconds * 125)):
        swing = 0.5 - 0.5 * np.cos(3 * tick / 125)
        plant.set_targets({FF3: swing, "rh_FFJ0": 2 * swing})
        plant.advance(0.008)
        seen.append(plant.measure()[1])
    return np.array(seen)


def test_without_effects_it_is_the_hand_that_mujoco_simulates(hand: Hand) -> None:
    model = mujoco.MjModel.from_xml_path(str(hand.model_path))
    model.opt.timestep, model.opt.integrator = 0.0005, mujoco.mjtIntegrator.mjINT_EULER
    data = mujoco.MjData(model)
    plant = Plant(hand)
    for name, target in (("rh_FFJ3", 1.2), ("rh_MFJ0", 2.0), ("rh_WRJ1", 0.3)):
        plant.set_targets({name: target})
        data.actuator(hand.description.commands[name].actuator).ctrl = target
    plant.advance(0.6)
    mujoco.mj_step(model, data, 1200)
    assert np.abs(plant.rig.data.qpos - data.qpos).max() < 1e-12


def test_the_same_seed_repeats_and_another_differs(hand: Hand) -> None:
    hidden = [parse_hidden("stribeck_friction", hand), parse_hidden("x_sensor_stick=severe", hand)]
    first, again, other = (Plant(hand, seed=seed, hidden=hidden, spread=0.2) for seed in (4, 4, 5))
    one = wave(first)
    assert np.array_equal(one, wave(again))
    assert not np.array_equal(one, wave(other))
    first.reset()
    assert np.array_equal(one, wave(first))


def test_a_reset_forgets_every_effect(hand: Hand) -> None:
    keys = [key for key in HIDDEN if key != "backlash"]
    plant = Plant(hand, hidden=[parse_hidden(key, hand) for key in keys])
    one = wave(plant, 0.5)
    plant.reset()
    assert np.array_equal(one, wave(plant, 0.5))


def test_the_spread_keeps_within_its_bounds_and_is_physical(hand: Hand) -> None:
    bare, spread = Plant(hand).rig, Plant(hand, spread=0.3, seed=2).rig
    for name, factor in spread.factors.items():
        assert np.all((factor >= 0.7) & (factor <= 1.3)), name
        assert np.all(Plant(hand).rig.factors[name] == 1.0)
    assert np.allclose(spread.model.dof_damping, bare.model.dof_damping * spread.factors["damping"])
    assert np.allclose(spread.gain, bare.gain * spread.factors["kp"])
    assert np.ptp(spread.factors["kp"]) > 0.2
    for value in (-0.1, 1.0):
        with pytest.raises(BadInput, match="spread"):
            Plant(hand, spread=value)


def test_measurements_are_noisy_and_quantised_as_described(hand: Hand) -> None:
    plant = Plant(hand)
    plant.advance(0.5)
    names, position, velocity, effort = plant.measure()
    assert names == hand.joints
    assert position.shape == velocity.shape == effort.shape == (24,)
    for name, angle in zip(names, position, strict=True):
        resolution = hand.description.joints[name].resolution_rad
        if resolution:
            assert angle / resolution == pytest.approx(round(angle / resolution), abs=1e-6)
    column = names.index("rh_WRJ1")
    seen = np.array([plant.measure()[1][column] for _ in range(400)])
    assert seen.std() == pytest.approx(hand.description.joints["rh_WRJ1"].noise_rad, rel=0.15)


def test_joints_of_one_motor_share_velocity_and_effort(hand: Hand) -> None:
    plant = Plant(hand, ideal_sensors=True)
    for tick in range(100):
        plant.set_targets({"FFJ0": 0.01 * tick})
        plant.advance(0.008)
        _, _, velocity, effort = plant.measure()
    one, two = hand.joints.index("rh_FFJ1"), hand.joints.index("rh_FFJ2")
    assert velocity[one] == velocity[two] == pytest.approx(1.25, rel=0.05)
    assert effort[one] == effort[two] > 0.1


def test_time_is_kept_whatever_the_length_of_the_calls(hand: Hand) -> None:
    plant = Plant(hand)
    for _ in range(300):
        plant.advance(1 / 300)
    assert plant.time_s == pytest.approx(1.0, abs=0.0003)


def test_targets_beyond_the_range_are_cut_and_unknown_or_undefined_ones_refused(hand: Hand) -> None:
    plant = Plant(hand)
    plant.set_targets({FF3: 9.0})
    assert plant.targets[hand.commands.index(FF3)] == pytest.approx(1.5708)
    with pytest.raises(BadInput, match="rh_FFJ3"):
        plant.set_targets({"rh_FFJ33": 0.1})
    with pytest.raises(BadInput, match="no angle"):
        plant.set_targets({FF3: float("nan")})


def test_wear_changes_an_effect_while_the_hand_runs(hand: Hand) -> None:
    keys = ("viscous_friction", "coulomb_friction", "armature", "payload", "gravity_tilt", "command_delay")
    plant = Plant(hand, hidden=[parse_hidden(f"{key}=0", hand) for key in keys])
    gravity = plant.rig.model.opt.gravity.copy()
    wave(plant, 0.2)
    for key in keys:
        plant.set_hidden(key, 0.05)
    worn = {one.key: one.value for one in plant.hidden}
    assert worn == dict.fromkeys(keys, 0.05)
    assert not np.allclose(plant.rig.model.opt.gravity, gravity)
    fresh = Plant(hand, hidden=[parse_hidden(f"{key}=0.05", hand) for key in keys])
    plant.reset()
    assert np.allclose(wave(plant, 0.4), wave(fresh, 0.4), atol=1e-9)
    with pytest.raises(BadInput, match="not hidden"):
        plant.set_hidden("backlash", 0.1)


@pytest.mark.parametrize(
    "key", ["tendon_elasticity", "backlash", "actuator_saturation", "rate_limit", "actuator_gain", "actuator_lag"]
)
def test_an_effect_that_was_neutral_can_come_with_wear(hand: Hand, key: str) -> None:
    plant = Plant(hand, hidden=[parse_hidden(f"{key}={HIDDEN[key].neutral}", hand)])
    plant.set_hidden(key, 0.1)
    fresh = Plant(hand, hidden=[parse_hidden(f"{key}=0.1", hand)])
    worn = wave(plant, 0.5)
    assert np.allclose(worn, wave(fresh, 0.5), atol=1e-9)
    assert np.abs(worn - wave(Plant(hand), 0.5)).max() > 1e-3


def test_an_unstable_plant_says_so(hand: Hand) -> None:
    plant = Plant(hand, hidden=[parse_hidden("spring:FFJ3=1e7", hand)])
    plant.set_targets({FF3: 1.0})
    with pytest.raises(TwinError, match="unstable"):
        plant.advance(1.0)


@pytest.mark.parametrize("model", ["third_party_hands/shadow_hand/right_hand.xml", "so101_real/so101.xml"])
def test_other_models_work_with_default_places_and_values(model: str) -> None:
    path = SHARED / model
    if not path.exists():
        pytest.skip(f"needs {path}")
    other = load_hand(model=path)
    pairs = any(len(info.joints) > 1 for info in other.description.commands.values())
    keys = [key for key, kind in HIDDEN.items() if (pairs or kind.acts_on != "finger") and key != "backlash"]
    plant = Plant(other, hidden=[parse_hidden(key, other) for key in keys], spread=0.2)
    plant.set_targets(dict.fromkeys(other.commands, 0.1))
    plant.advance(0.5)
    assert np.isfinite(plant.measure()[1]).all()
