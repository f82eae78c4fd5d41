"""Effects that no library knows: they too do what they say."""

from __future__ import annotations

import numpy as np
import pytest

from .conftest import FF3, KP, Drive, ramp, step, triangle, width

SLOW = triangle(0.2, 1.0, 1.2)


def test_grit_is_felt_within_its_band_only(drive: Drive) -> None:
    hidden = "x_sticky_patch:FFJ3=0.3,center=0.5,width=0.1"  # about 0.654 rad, 0.183 rad wide
    bare = drive(motion={FF3: SLOW}, seconds=2.4)
    gritty = drive(hidden, motion={FF3: SLOW}, seconds=2.4)
    extra = {at: width(gritty, at, SLOW, 2.4) - width(bare, at, SLOW, 2.4) for at in (0.4, 0.66, 0.9)}
    assert extra[0.66] == pytest.approx(2 * 0.3 / KP, rel=0.05)
    assert abs(extra[0.4]) < 1e-3
    assert abs(extra[0.9]) < 1e-3


def test_a_creeping_tendon_drifts_under_load_and_comes_back(drive: Drive) -> None:
    def motion(t: float) -> float:
        return 1.0 if t < 5.0 else 0.0

    run = drive("spring:FFJ3=1", "x_creep:FFJ3=0.1,time=1", motion={FF3: motion}, seconds=9.0, rate_hz=25, settle_s=0.2)
    q = run.column(FF3)
    assert q[0] - q[120] > 0.05  # it gives way by compliance times torque, slowly
    assert abs(q[-1]) < 0.012


def test_a_hot_servo_weakens_while_it_works(drive: Drive) -> None:
    spring = "spring:FFJ3=1"
    hidden = "x_thermal_fade:FFJ3=0.8,time=1,hot=0.3"
    cold = drive(spring, motion={FF3: ramp(1.0, 0.0)}, seconds=3.0, settle_s=0.3).column(FF3)
    hot = drive(spring, hidden, motion={FF3: ramp(1.0, 0.0)}, seconds=3.0, settle_s=0.3).column(FF3)
    assert abs(cold[-1] - cold[10]) < 1e-3
    assert hot[10] - hot[-1] > 0.02


def test_a_sticking_encoder_repeats_itself_while_the_joint_moves(drive: Drive) -> None:
    motion = {FF3: lambda t: 0.6 + 0.4 * np.sin(2 * t)}
    run = drive("x_sensor_stick:FFJ3=0.3", motion=motion, seconds=8.0)
    still = np.diff(run.column(FF3)) == 0.0
    column = run.joints.index(FF3)
    assert 0.1 < still.mean() < 0.5
    assert np.abs(np.diff(run.true_position[:, column]))[still].max() > 1e-3
    assert (run.position == run.true_position).all(axis=0).sum() == len(run.joints) - 1


def test_crosstalk_shows_a_share_of_the_neighbours_motion(drive: Drive) -> None:
    run = drive("x_crosstalk:FFJ3=0.1", motion={"rh_FFJ0": ramp(0.0, 0.5)}, seconds=3.0)
    leak = run.column(FF3) - run.true_position[:, run.joints.index(FF3)]
    assert np.allclose(leak, 0.1 * run.column("rh_FFJ2"), atol=1e-12)
    assert np.ptp(leak) > 0.05


def test_a_dead_band_gives_no_torque_for_small_errors(drive: Drive) -> None:
    run = drive("x_dead_band_controller:FFJ3=0.05", motion={FF3: step(0.4, 0.7)}, seconds=1.0)
    error = 0.7 - run.column(FF3)
    effort = run.effort[:, run.joints.index(FF3)]
    late = run.time_s > 0.3
    assert np.all(effort[late & (np.abs(error) < 0.04)] == 0.0)
    assert 0.005 < abs(error[-1]) < 0.05


def test_a_slipping_tendon_loses_its_zero_in_whole_steps(drive: Drive) -> None:
    hidden = "x_slip:FFJ3=0.03,threshold=1.0,pause=0.2"
    motion = {FF3: step(0.2, 0.7)}
    bare = drive(motion=motion, seconds=2.0).column(FF3)
    slipped = drive(hidden, motion=motion, seconds=2.0).column(FF3)
    jumps = (bare[-1] - slipped[-1]) / 0.03
    assert jumps == pytest.approx(round(jumps), abs=0.1)
    assert round(jumps) >= 1
    gentle = {FF3: ramp(0.2, 0.2)}
    same = drive(hidden, motion=gentle, seconds=1.0).column(FF3) - drive(motion=gentle, seconds=1.0).column(FF3)
    assert np.abs(same).max() == 0.0


def test_an_asymmetric_servo_pulls_better_than_it_releases(drive: Drive) -> None:
    def sag(target: float, *hidden: str) -> float:
        q = drive("spring:FFJ3=2,ref=0.7", *hidden, motion={FF3: ramp(target, 0.0)}, seconds=1.0).column(FF3)[-1]
        return abs(target - float(q))

    uneven = "x_asymmetric_gain:FFJ3=0.4"
    assert sag(1.2, uneven) == pytest.approx(0.5 * 2 / (1.4 * KP + 2), abs=0.006)
    assert sag(0.2, uneven) == pytest.approx(0.5 * 2 / (0.6 * KP + 2), abs=0.006)
