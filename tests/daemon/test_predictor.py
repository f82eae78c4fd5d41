"""The live prediction is the same physics as an offline roll-out, with bounded work."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from twin_daemon.daemon.predictor import Predictor
from twin_daemon.simulation.twin import TwinModel

MS = 1_000_000
START = 1_700_000_000_000 * MS


def pose(twin: TwinModel, value: float = 0.2) -> np.ndarray:
    """Every joint at `value`, as far as its range goes."""
    ranges = np.array([twin.hand.joint_range_rad[name] for name in twin.joints])
    return np.clip(np.full(len(twin.joints), value), ranges[:, 0], ranges[:, 1])


def test_prediction_equals_an_offline_roll_out_of_the_same_commands(twin: TwinModel) -> None:
    predictor = Predictor(twin, horizon_s=100.0)
    start, still = pose(twin), np.zeros(len(twin.joints))
    step_s = twin.model.opt.timestep
    steps, every = 500, round(0.008 / step_s)
    rng = np.random.default_rng(1)
    targets = rng.uniform(0.0, 1.0, (steps // every, len(twin.actuators)))

    predictor.command(START, twin.actuators, targets[0])
    predicted = []
    for sample in range(steps // every):
        stamp = START + sample * 8 * MS
        predictor.command(stamp, twin.actuators, targets[sample])
        predicted.append(predictor.advance(stamp, start, still).position)

    data = mujoco.MjData(twin.model)
    data.qpos[:] = twin.initial_qpos(start)
    offline = []
    for target in targets:
        offline.append(data.qpos[twin.qpos_adr].copy())
        data.ctrl[:] = target
        mujoco.mj_step(twin.model, data, nstep=every)
    np.testing.assert_allclose(np.array(predicted), np.array(offline), atol=1e-12)


def test_stamps_need_not_fall_on_steps(twin: TwinModel) -> None:
    fine, coarse = Predictor(twin, horizon_s=100.0), Predictor(twin, horizon_s=100.0)
    still = np.zeros(len(twin.joints))
    for predictor in (fine, coarse):
        predictor.command(START, twin.actuators, np.full(len(twin.actuators), 0.6))
        predictor.advance(START, pose(twin), still)
    for stamp in range(1, 201):
        last = fine.advance(START + stamp * MS + 300_000, pose(twin), still)
    same = [coarse.advance(START + stamp * 20 * MS, pose(twin), still) for stamp in range(1, 11)][-1]
    np.testing.assert_allclose(last.position, same.position, atol=2e-3)


def test_without_commands_the_measured_pose_is_the_target(twin: TwinModel) -> None:
    predictor = Predictor(twin)
    assert predictor.state == "waiting"
    measured = pose(twin, 0.3)
    for sample in range(100):
        prediction = predictor.advance(START + sample * 8 * MS, measured, np.zeros_like(measured))
    assert predictor.state == "no_commands"
    assert predictor.targets_rad == {}
    assert np.abs(prediction.position - measured).max() < 0.25


def test_the_model_is_anchored_at_the_start_each_horizon_and_after_a_gap(twin: TwinModel) -> None:
    predictor = Predictor(twin, horizon_s=0.4, max_catch_up_s=0.5)
    still = np.zeros(len(twin.joints))
    for sample in range(126):
        predictor.advance(START + sample * 8 * MS, pose(twin), still)
    assert predictor.anchors == {"start": 1, "horizon": 2}
    steps = predictor.steps
    after = predictor.advance(START + 10_000 * MS, pose(twin, 0.5), still)
    assert after.anchored == "gap"
    assert predictor.steps == steps, "a gap costs no simulation"
    np.testing.assert_array_equal(after.position, pose(twin, 0.5))


def test_a_command_from_the_future_waits_for_its_moment(twin: TwinModel) -> None:
    early, late = Predictor(twin), Predictor(twin)
    still = np.zeros(len(twin.joints))
    for predictor, delay in ((early, 0), (late, 80)):
        predictor.advance(START, pose(twin), still)
        predictor.command(START + delay * MS, ("rh_FFJ3",), np.array([1.2]))
    index = twin.joints.index("rh_FFJ3")
    at_80 = [p.advance(START + 80 * MS, pose(twin), still).position[index] for p in (early, late)]
    assert at_80[0] - at_80[1] > 0.3
    assert at_80[1] == pytest.approx(0.2, abs=0.1)
    assert late.advance(START + 160 * MS, pose(twin), still).position[index] > at_80[1] + 0.3


def test_commands_sent_ahead_of_the_first_state_wait_for_their_moment_too(twin: TwinModel) -> None:
    predictor = Predictor(twin)
    for delay, target in ((-8, 0.1), (80, 0.5), (3_600_000, 0.9)):  # the last bears another clock's stamp
        predictor.command(START + delay * MS, ("rh_FFJ3" if delay < 1000 else "rh_MFJ3",), np.array([target]))
    predictor.advance(START, pose(twin), np.zeros(len(twin.joints)))
    assert predictor.targets_rad == {"rh_FFJ3": 0.1, "rh_MFJ3": 0.9}
    predictor.advance(START + 160 * MS, pose(twin), np.zeros(len(twin.joints)))
    assert predictor.targets_rad == {"rh_FFJ3": 0.5, "rh_MFJ3": 0.9}


def test_commands_that_drive_nothing_are_not_followed(twin: TwinModel) -> None:
    predictor = Predictor(twin)
    assert not predictor.command(START, ("gripper",), np.array([1.0]))
    assert not predictor.command(START, ("rh_FFJ3",), np.array([np.nan]))
    predictor.advance(START, pose(twin), np.zeros(len(twin.joints)))
    assert predictor.state == "no_commands"


def test_a_tendon_follows_the_sum_of_its_joints_when_they_are_commanded(twin: TwinModel) -> None:
    predictor = Predictor(twin)
    assert predictor.command(START, ("rh_FFJ1", "rh_FFJ2"), np.array([0.4, 0.7]))
    predictor.advance(START, pose(twin), np.zeros(len(twin.joints)))
    assert predictor.targets_rad["rh_FFJ0"] == pytest.approx(1.1)
    assert not predictor.command(START, ("rh_FFJ1", "rh_FFJ2"), np.array([0.4, np.nan]))
    assert predictor.targets_rad["rh_FFJ0"] == pytest.approx(1.1)


def test_another_model_inherits_the_targets(twin: TwinModel) -> None:
    before, after = Predictor(twin), Predictor(twin)
    before.command(START, ("rh_FFJ3",), np.array([0.8]))
    before.advance(START, pose(twin), np.zeros(len(twin.joints)))
    after.inherit(before)
    assert after.targets_rad == {"rh_FFJ3": 0.8}


def test_a_contact_loads_the_joints_between_its_bodies_until_the_next_anchor(twin: TwinModel) -> None:
    predictor = Predictor(twin, horizon_s=1.0)
    apart, still = pose(twin, 0.0), np.zeros(len(twin.joints))
    predictor.command(START, ("rh_MFJ4",), np.array([-0.3]))
    seen = [predictor.advance(START + sample * 8 * MS, apart, still).touched for sample in range(127)]
    loaded = {name for name, touched in zip(twin.joints, seen[125], strict=True) if touched}
    # J1 hangs on the tendon that J2 hangs on; the wrist carries both fingers
    assert {f"rh_{finger}J{i}" for finger in ("FF", "MF") for i in (1, 2, 3, 4)} <= loaded
    assert not loaded & {"rh_WRJ1", "rh_WRJ2", "rh_THJ1", "rh_LFJ3", "rh_RFJ3"}
    assert not seen[0].any()
    assert not seen[126].any()  # one second is over: the model starts from the measurement
