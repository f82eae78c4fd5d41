"""Roll-outs in which a torque follows from the state, step by step: for laws that MuJoCo has no element for.

A torque that is written down in advance cannot depend on where a joint comes to lie. Here all simulations advance by
one step together, and between two steps the torque of each is computed from all their states at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from mujoco import batch

from twin_daemon.processor_time import thread_count
from twin_daemon.simulation.rollout import place_in_state

Torque = Callable[[int, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(step, (a, nq) positions, (a, nv) velocities, (a, nu) controls) of the first a simulations -> (a, nv) N m."""

_QPOS = mujoco.mjtState.mjSTATE_QPOS.value
_QVEL = mujoco.mjtState.mjSTATE_QVEL.value
_INPUT = mujoco.mjtState.mjSTATE_CTRL.value | mujoco.mjtState.mjSTATE_QFRC_APPLIED.value


def roll_out_with_feedback(
    models: Sequence[mujoco.MjModel],
    states: np.ndarray,
    inputs: np.ndarray,
    input_of: np.ndarray,
    steps: np.ndarray,
    torque: Torque,
    *,
    threads: int | None = 1,
) -> np.ndarray:
    """Positions (B, T + 1, nq) of B simulations, the initial state first; NaN where one has ended or diverged.

    `states` (B, n) are whole states of MuJoCo. `inputs` (d, T, nu + nv) are controls and generalised forces by step;
    simulation b gets those of row `input_of[b]`, for `steps[b]` steps. `steps` (B,) must not increase: who ends
    first stands last, so that those that still run are always the first ones. More than one thread waits for the
    slowest at every step: on a busy machine that costs more than it gives.
    """
    if np.any(np.diff(steps) > 0):
        raise ValueError("simulations must stand in the order of their lengths, longest first")
    first, count = models[0], len(states)
    runner = batch.Batch(first, count, threads or thread_count())
    runner.set_models(list(models))
    runner.state[:] = states
    runner.warning[:] = 0
    qpos, qvel = place_in_state(first, _QPOS), place_in_state(first, _QVEL)
    ids = np.arange(count, dtype=np.int32)
    out = np.full((count, int(steps.max(initial=0)) + 1, first.nq), np.nan)
    out[:, 0] = runner.state[:, qpos]
    running = np.searchsorted(-steps, -np.arange(out.shape[1] - 1), side="left")
    for step, active in enumerate(running):
        now = inputs[input_of[:active], step]
        position, velocity = runner.state[:active, qpos], runner.state[:active, qvel]
        now[:, first.nu :] += torque(step, position, velocity, now[:, : first.nu])
        runner.rollout(1, now[:, None], _INPUT, record=(), ids=ids[:active])
        out[:active, step + 1] = runner.state[:active, qpos]
    out[runner.warning.reshape(count, -1).any(axis=1)] = np.nan
    return out
