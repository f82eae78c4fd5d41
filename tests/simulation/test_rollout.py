"""One roll-out function that everything can rely on: the same numbers as a plain loop, on any number of threads."""

from __future__ import annotations

import copy

import mujoco
import numpy as np
import pytest

from twin_daemon.simulation.rollout import roll_out, settle_actuators
from twin_daemon.simulation.terms import EffectTerm, Terms
from twin_daemon.simulation.twin import TwinModel

STEPS = 300


def waves(twin: TwinModel, count: int, rng: np.random.Generator) -> np.ndarray:
    """(count, STEPS, nu): closing and opening, every sequence another."""
    low, high = np.clip(twin.model.actuator_ctrlrange.T, 0.0, 1.2)
    phase = rng.uniform(0.5, 2.0, (count, 1, twin.model.nu)) * np.linspace(0, np.pi, STEPS)[None, :, None]
    return low + (high - low) * np.sin(phase) ** 2


def test_it_is_a_plain_loop_to_the_last_bit_on_one_and_on_two_threads(
    twin: TwinModel, rng: np.random.Generator
) -> None:
    controls = waves(twin, 3, rng)
    models = [copy.copy(twin.model) for _ in range(3)]
    for index, model in enumerate(models):
        model.dof_damping[:] *= 1.0 + index
    start = twin.model.qpos0[None]
    one = roll_out(models, controls, start, threads=1)
    assert np.array_equal(one, roll_out(models, controls, start, threads=2))
    for index, model in enumerate(models):
        data = mujoco.MjData(model)
        data.ctrl[:] = controls[index, 0]
        for step in range(STEPS):
            data.ctrl[:] = controls[index, step]
            mujoco.mj_step(model, data)
            assert np.array_equal(one[index, step + 1], data.qpos), f"model {index}, step {step}"


def test_no_clock_is_read_at_any_stage_of_a_step(twin: TwinModel) -> None:
    """The bindings' own is a third of a small model's roll-out; without it a step takes no time that it knows of."""
    data = mujoco.MjData(twin.model)
    mujoco.mj_step(twin.model, data, nstep=10)
    step = data.timer[mujoco.mjtTimer.mjTIMER_STEP]
    assert (step.number, step.duration) == (10, 0.0)


def test_one_model_serves_many_command_sequences(twin: TwinModel, rng: np.random.Generator) -> None:
    controls = waves(twin, 2, rng)
    together = roll_out([twin.model], controls, twin.model.qpos0[None])
    alone = [roll_out([twin.model], row[None], twin.model.qpos0[None])[0] for row in controls]
    assert np.array_equal(together, np.stack(alone))


def test_a_simulation_that_diverges_is_nan_from_there_and_leaves_the_others_alone(
    twin: TwinModel, rng: np.random.Generator
) -> None:
    controls = waves(twin, 1, rng)
    broken = copy.copy(twin.model)
    broken.jnt_stiffness[:] = -1e9
    out = roll_out([twin.model, broken], controls, twin.model.qpos0[None])
    assert np.isfinite(out[0]).all()
    assert np.isnan(out[1, -1]).all()
    assert np.isfinite(out[1, 0]).all()


def test_a_delayed_actuator_starts_as_if_it_had_been_told_so_for_ever(twin: TwinModel) -> None:
    late = twin.changed(Terms(effects=(EffectTerm(effect="command_delay", target="rh_FFJ3", values={}),)))
    start = twin.initial_qpos(np.where(np.array(twin.joints) == "rh_FFJ3", 0.7, np.nan))
    column = twin.qpos_adr[twin.joints.index("rh_FFJ3")]
    hold = np.zeros((1, 100, twin.model.nu))
    hold[..., twin.actuators.index("rh_FFJ3")] = 0.7
    prompt, delayed = (roll_out([t.model], hold, start[None])[0, :, column] for t in (twin, late))
    np.testing.assert_allclose(delayed, prompt, atol=1e-9)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("actuator_lag", {"tau": 0.08}),
        ("command_delay", {"delay": 0.05}),
        ("rate_limit", {"rate": 1.0}),
    ],
)
def test_a_roll_out_from_the_middle_knows_the_commands_before(
    key: str, values: dict[str, float], twin: TwinModel, rng: np.random.Generator
) -> None:
    late = twin.changed(Terms(effects=(EffectTerm(effect=key, target="rh_FFJ3", values=values),)))
    controls, cut = waves(late, 1, rng), 200
    whole = roll_out([late.model], controls, late.model.qpos0[None])[0]
    # the state at the cut, speeds included, from a plain loop that starts as the whole one did
    data = mujoco.MjData(late.model)
    data.ctrl[:] = controls[0, 0]
    settle_actuators(late.model, data, controls[0, 0])
    for step in range(cut):
        data.ctrl[:] = controls[0, step]
        mujoco.mj_step(late.model, data)
    rest = controls[:, cut:]
    later = roll_out([late.model], rest, data.qpos[None], data.qvel[None], before=controls[:, :cut])[0]
    np.testing.assert_allclose(later, whole[cut:], atol=1e-6)
    forgotten = roll_out([late.model], rest, data.qpos[None], data.qvel[None])[0]
    assert np.abs(forgotten - whole[cut:]).max() > 1e-3


def test_dry_friction_that_holds_a_load_holds_it_from_the_first_step(twin: TwinModel) -> None:
    term = EffectTerm(effect="coulomb_friction", target="rh_FFJ3", values={"friction": 0.4})
    stuck = twin.changed(Terms(effects=(term,)))
    column = stuck.joints.index("rh_FFJ3")
    pose = np.zeros(len(stuck.joints))
    pose[column] = 0.5
    controls = np.zeros((1, 400, len(stuck.actuators)))
    controls[..., stuck.actuators.index("rh_FFJ3")] = 0.52  # 0.2 N m, which the friction holds
    start = stuck.initial_qpos(pose)[None]
    held = roll_out([stuck.model], controls, start, loaded=True)[0][:, stuck.qpos_adr[column]]
    assert np.ptp(held) < 3e-4
    relaxed = roll_out([stuck.model], controls, start)[0][:, stuck.qpos_adr[column]]
    assert np.ptp(relaxed) > 3e-4
