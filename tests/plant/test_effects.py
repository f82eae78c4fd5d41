"""Each hidden effect does what its physics says, to the number."""

from __future__ import annotations

import math

import numpy as np
import pytest

from twin_daemon.hand import Hand
from twin_daemon.plant import Plant, parse_hidden

from .conftest import FF3, KP, Drive, ramp, step, triangle, width

LEG_S = 1.2
SLOW = triangle(0.2, 1.0, LEG_S)


def loop(drive: Drive, *hidden: str, at: float = 0.6) -> float:
    """Width of the loop of a slow up and down, beyond that of the nominal hand."""
    bare = width(drive(motion={FF3: SLOW}, seconds=2 * LEG_S), at, SLOW, 2 * LEG_S)
    return width(drive(*hidden, motion={FF3: SLOW}, seconds=2 * LEG_S), at, SLOW, 2 * LEG_S) - bare


def lag(drive: Drive, speed: float, *hidden: str) -> float:
    """rad by which the hand with the effect trails the nominal one on a steady ramp."""
    seconds = min(0.6 / speed, 2.0)
    bare = drive(motion={FF3: ramp(0.2, speed)}, seconds=seconds).column(FF3)
    with_it = drive(*hidden, motion={FF3: ramp(0.2, speed)}, seconds=seconds).column(FF3)
    late = slice(int(0.6 * len(bare)), None)
    return float(np.mean(bare[late] - with_it[late]))


def rest(drive: Drive, target: float, *hidden: str, seconds: float = 1.0) -> float:
    """rad where the joint comes to rest, approached from below."""
    return float(drive(*hidden, motion={FF3: step(target - 0.3, target)}, seconds=seconds).column(FF3)[-1])


def test_viscous_friction_makes_the_joint_trail_in_proportion_to_speed(drive: Drive) -> None:
    assert lag(drive, 0.5, "viscous_friction:FFJ3=0.4") == pytest.approx(0.4 * 0.5 / KP, rel=0.03)
    assert lag(drive, 1.0, "viscous_friction:FFJ3=0.4") == pytest.approx(0.4 * 1.0 / KP, rel=0.03)


def test_coulomb_friction_opens_a_loop_of_twice_its_torque(drive: Drive) -> None:
    assert loop(drive, "coulomb_friction:FFJ3=0.2") == pytest.approx(2 * 0.2 / KP, rel=0.03)
    assert loop(drive, "coulomb_friction:FFJ3=0.2", at=0.9) == pytest.approx(2 * 0.2 / KP, rel=0.03)


def test_coulomb_friction_holds_a_load_at_rest_without_creeping(drive: Drive) -> None:
    angle = drive("coulomb_friction:FFJ3=0.3", motion={FF3: step(0.5, 0.52)}, seconds=4.0).column(FF3)
    assert abs(angle[-1] - angle[100]) < 2e-5
    assert angle[-1] < 0.505  # 0.2 N m of servo torque do not move it


def test_stribeck_friction_fades_with_speed(drive: Drive) -> None:
    hidden = "stribeck_friction:FFJ3=0.02,velocity=0.3"
    assert lag(drive, 0.1, hidden) == pytest.approx(0.02 / KP * math.exp(-1 / 9), rel=0.1)
    assert abs(lag(drive, 1.0, hidden)) < 1e-5


def test_load_friction_grows_with_the_transmitted_torque(drive: Drive) -> None:
    spring = "spring:FFJ3=1.0"
    near = loop(drive, spring, "load_friction:FFJ3=0.3", at=0.35) - loop(drive, spring, at=0.35)
    far = loop(drive, spring, "load_friction:FFJ3=0.3", at=0.9) - loop(drive, spring, at=0.9)
    assert far == pytest.approx(2 * 0.3 * 0.9 / KP, rel=0.2)
    assert far > 1.8 * near


def test_backlash_is_a_dead_zone_as_wide_as_the_gap_at_every_reversal(drive: Drive) -> None:
    assert loop(drive, "backlash:rh_FFJ3=0.05") == pytest.approx(0.05, rel=0.03)
    assert loop(drive, "backlash:rh_FFJ3=0.05", at=0.85) == pytest.approx(0.05, rel=0.03)


def test_a_servo_is_silent_up_to_its_band_on_either_side(drive: Drive) -> None:
    assert loop(drive, "dead_zone:rh_FFJ3=0.025") == pytest.approx(0.05, rel=0.03)


def test_hysteresis_is_narrow_after_a_reversal_and_full_further_on(drive: Drive) -> None:
    hidden = "hysteresis:FFJ3=0.2,yield_angle=0.1"
    full = 2 * 0.2 / KP
    assert loop(drive, hidden, at=0.5) == pytest.approx(full, rel=0.05)
    assert loop(drive, hidden, at=0.96) < 0.6 * full


def test_tendon_elasticity_yields_under_load(drive: Drive) -> None:
    stiffness = 1.0 / (1.0 / KP + 0.1)
    expected = stiffness * 1.0 / (stiffness + 1.0) - KP / (KP + 1.0)
    soft = rest(drive, 1.0, "spring:FFJ3=1.0", "tendon_elasticity:FFJ3=0.1") - rest(drive, 1.0, "spring:FFJ3=1.0")
    assert soft == pytest.approx(expected, abs=0.004)


def test_tendon_elasticity_lets_the_joint_trail_by_its_own_damping(drive: Drive) -> None:
    hidden = "tendon_elasticity:FFJ3=0.3"
    damping = 0.1  # N m s/rad: the joint's half of the nominal damping
    trailing = lag(drive, 1.0, hidden) - lag(drive, 0.5, hidden)
    assert trailing == pytest.approx(damping * 0.5 * 0.3, rel=0.2)


def test_coupling_closes_the_middle_joint_first_and_the_last_one_at_the_end(drive: Drive) -> None:
    run = drive("coupling:rh_FFJ0=0.5", motion={"rh_FFJ0": lambda t: min(t, 2.9)}, seconds=3.5)
    last, middle, total = run.column("rh_FFJ1"), run.column("rh_FFJ2"), run.column("rh_FFJ1") + run.column("rh_FFJ2")
    half = int(np.searchsorted(total, 1.2))
    assert last[half] < 0.1 < 1.05 < middle[half]
    assert last[-1] > 1.2


def test_a_spring_shifts_the_balance(drive: Drive) -> None:
    assert rest(drive, 1.0, "spring:FFJ3=2") - rest(drive, 1.0) == pytest.approx(KP / (KP + 2) - 1, abs=0.006)
    shifted = rest(drive, 0.8, "spring:FFJ3=2,ref=0.8") - rest(drive, 0.8)
    assert abs(shifted) < 0.004


def test_a_cubic_spring_hardens(drive: Drive) -> None:
    for target in (0.5, 1.0):
        q = rest(drive, target, "nonlinear_spring:FFJ3=1")
        assert KP * (target - q) == pytest.approx(q**3, abs=0.08)  # the rest is friction and weight


def test_a_soft_stop_is_not_felt_before_it_begins(drive: Drive) -> None:
    begins = 1.5708 - 0.5
    hidden = "joint_stop:FFJ3=0.5,stiffness=10"
    assert rest(drive, begins - 0.02, hidden) == rest(drive, begins - 0.02)
    pressed = rest(drive, begins + 0.2, hidden) - begins
    assert pressed == pytest.approx(0.2 * KP / (KP + 10), abs=0.005)


def test_armature_slows_the_first_moment_of_a_step(hand: Hand) -> None:
    moved = []
    for hidden in ((), (parse_hidden("armature:FFJ3=0.004", hand),)):
        plant = Plant(hand, hidden=hidden)
        plant.advance(0.5)
        before = plant.position[hand.joints.index(FF3)]
        plant.set_targets({FF3: before + 0.15})
        plant.advance(0.003)
        moved.append(plant.position[hand.joints.index(FF3)] - before)
    inertia = Plant(hand).rig.inertia_at(FF3)
    assert moved[0] / moved[1] == pytest.approx((inertia + 0.004) / inertia, rel=0.12)


def test_a_payload_pulls_by_its_weight_times_its_lever(drive: Drive) -> None:
    q = rest(drive, 1.2)
    expected = 0.4 * 9.81 * 0.045 * math.sin(q) / KP
    assert rest(drive, 1.2, "payload:FFJ3=0.4") - q == pytest.approx(expected, rel=0.12)


def test_gravity_keeps_its_size_when_it_tilts_and_turns_the_sag_round(drive: Drive, hand: Hand) -> None:
    tilted = Plant(hand, hidden=[parse_hidden("gravity_tilt=0.4", hand)]).rig.model.opt.gravity
    assert np.linalg.norm(tilted) == pytest.approx(9.81)
    assert tilted[2] == pytest.approx(-9.81 * math.cos(0.4))
    load = "payload:FFJ3=0.4"
    upright, hanging = rest(drive, 1.2, load), rest(drive, 1.2, load, "gravity_tilt=3.14159")
    assert upright > 1.2 > hanging


def test_a_weak_servo_holds_a_load_worse(drive: Drive) -> None:
    q = rest(drive, 1.0, "spring:FFJ3=1", "actuator_gain:FFJ3=0.5")
    assert q == pytest.approx(0.5 * KP / (0.5 * KP + 1.0), abs=0.01)


def test_saturation_caps_the_torque(drive: Drive) -> None:
    run = drive("actuator_saturation:FFJ3=0.3", motion={FF3: step(0.2, 1.2)}, seconds=1.0)
    effort = np.abs(run.effort[:, run.joints.index(FF3)])
    assert effort.max() == pytest.approx(0.3)
    assert np.sum(effort > 0.2999) > 20


def test_a_lag_trails_a_ramp_by_its_time_constant(drive: Drive) -> None:
    assert lag(drive, 0.5, "actuator_lag:FFJ3=0.05") == pytest.approx(0.05 * 0.5, rel=0.02)


def test_a_rate_limit_is_never_exceeded(drive: Drive) -> None:
    run = drive("rate_limit:FFJ3=0.8", motion={FF3: step(0.2, 1.2)}, seconds=2.0)
    speed = np.diff(run.column(FF3)) / np.diff(run.time_s)
    assert speed.max() < 0.8 * 1.1  # the loop's own overshoot at the start
    assert np.median(speed[20:140]) == pytest.approx(0.8, rel=0.01)


def test_a_delay_shifts_the_motion_and_changes_nothing_else(drive: Drive) -> None:
    def motion(t: float) -> float:
        return 0.5 + 0.3 * math.sin(3 * max(t - 0.2, 0.0))

    bare = drive(motion={FF3: motion}, seconds=3.0).column(FF3)
    late = drive("command_delay:FFJ3=0.04", motion={FF3: motion}, seconds=3.0).column(FF3)
    assert np.abs(late[5:] - bare[:-5]).max() < 1e-4


def test_ripple_repeats_with_the_motors_angle(drive: Drive) -> None:
    motion = ramp(0.1, 0.4)
    hidden = "torque_ripple:FFJ3=0.2,cycles=25"
    bare = drive(motion={FF3: motion}, seconds=3.0).column(FF3)
    rough = drive(hidden, motion={FF3: motion}, seconds=3.0).column(FF3)
    error, angle = (rough - bare)[50:], rough[50:]
    spectrum = [abs(np.mean(error * np.exp(1j * k * angle))) for k in range(5, 60)]
    assert 5 + int(np.argmax(spectrum)) == pytest.approx(25, abs=1)
    assert np.ptp(error) == pytest.approx(2 * 0.2 / KP, rel=0.15)


def test_sensor_offset_and_gain_change_the_reading_only(drive: Drive) -> None:
    bare = drive(motion={FF3: SLOW}, seconds=2.0)
    moved = drive("sensor_offset:FFJ3=-0.03", motion={FF3: SLOW}, seconds=2.0)
    scaled = drive("sensor_gain:FFJ3=1.05", motion={FF3: SLOW}, seconds=2.0)
    assert np.allclose(moved.column(FF3), bare.column(FF3) - 0.03, rtol=0, atol=1e-15)
    assert np.allclose(scaled.column(FF3), bare.column(FF3) * 1.05, rtol=0, atol=1e-15)
    assert np.array_equal(moved.true_position, bare.true_position)


@pytest.mark.parametrize("key", ["viscous_friction", "coulomb_friction", "stribeck_friction", "x_sticky_patch"])
@pytest.mark.parametrize("place", ["FFJ3", "FFJ0"])
def test_friction_never_adds_energy(hand: Hand, key: str, place: str) -> None:
    plant = Plant(hand, hidden=[parse_hidden(f"{key}:{place}=severe", hand)])
    rig = plant.rig
    rig.model.opt.gravity[:] = 0.0
    rig.gain[:], rig.bias[:], rig.pull[:] = 0.0, 0.0, 0.0  # the servos let go
    plant.reset(dict.fromkeys(("rh_FFJ1", "rh_FFJ2", "rh_FFJ3"), 0.5))
    rig.data.qvel[rig.dof_of[[hand.joints.index(f"rh_FFJ{i}") for i in (1, 2, 3)]]] = (4.0, -2.0, 3.0)
    energy = []
    mass = np.linalg.inv(rig.inverse_mass)
    for _ in range(300):
        energy.append(0.5 * rig.data.qvel @ mass @ rig.data.qvel)
        plant.advance(0.0005)
    stored = 1e-5  # what a bent bristle may give back
    assert np.diff(energy).max() < stored
    assert energy[-1] < 0.01 * energy[0]
