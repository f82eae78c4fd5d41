"""The one roll-out function: many models driven by many command sequences, on all cores.

Runs on `mujoco.batch`, whose results are bit-identical to a plain mj_step loop at any number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Sequence

import mujoco
import numpy as np
from mujoco import batch

# A chunk of simulations keeps its controls and positions in memory at once; this bounds both.
_CHUNK_BYTES = 256 * 2**20
_TIME = mujoco.mjtState.mjSTATE_TIME.value


def thread_count() -> int:
    """Threads for roll-outs: TWIN_THREADS, or the cores that this process may use."""
    setting = os.environ.get("TWIN_THREADS", "")
    return int(setting) if setting.isdigit() and int(setting) > 0 else len(os.sched_getaffinity(0))


def roll_out(
    models: Sequence[mujoco.MjModel],
    controls: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray | None = None,
    *,
    threads: int | None = None,
) -> np.ndarray:
    """Positions of every simulation, (B, T + 1, nq), the initial state first.

    `models` has B models of the same sizes, or one for all. `controls` is (B or 1, T, nu): row k is applied
    during step k; actuators beyond its columns get 0. `qpos` is (B or 1, nq), `qvel` (B or 1, nv), zero where
    not given. Delay buffers start full of the first control, as if the hand had been told so for ever. From the
    step at which MuJoCo warns (a state that is not finite or diverges) a simulation's positions are NaN.
    """
    count = max(len(models), len(controls), len(qpos))
    first = models[0]
    extra = first.nu - controls.shape[2]
    if extra:  # actuators that stand for an effect take no command
        controls = np.concatenate([controls, np.zeros((*controls.shape[:2], extra))], axis=2)
    steps = controls.shape[1]
    bytes_each = 8 * steps * (first.nu + first.nq)
    chunk = max(1, min(count, _CHUNK_BYTES // max(bytes_each, 1)))
    out = np.empty((count, steps + 1, first.nq))
    runner = batch.Batch(first, chunk, threads or thread_count())
    for start in range(0, count, chunk):
        chosen = range(start, min(start + chunk, count))
        ids = np.arange(len(chosen), dtype=np.int32)
        picked = [models[i if len(models) > 1 else 0] for i in chosen]
        if len(models) > 1:
            runner.set_models([*picked, *[first] * (chunk - len(picked))])
        for slot, i in enumerate(chosen):
            runner.state[slot] = _initial_state(picked[slot], controls[_row(i, controls)][0], qpos[_row(i, qpos)],
                                                None if qvel is None else qvel[_row(i, qvel)])  # fmt: skip
        runner.warning[:] = 0
        rows = controls[start : start + len(chosen)] if len(controls) > 1 else controls
        recorded = runner.rollout(steps, rows, record=("qpos", _TIME), ids=ids)
        for slot, i in enumerate(chosen):
            out[i, 0] = qpos[_row(i, qpos)]
            out[i, 1:] = recorded["qpos"][slot]
            if runner.warning[slot].any():
                _blank_after_stop(out[i], recorded[_TIME][slot, :, 0], first.opt.timestep)
    return out


def _row(index: int, array: np.ndarray) -> int:
    return index if len(array) > 1 else 0


def _initial_state(model: mujoco.MjModel, control: np.ndarray, qpos: np.ndarray, qvel: np.ndarray | None) -> np.ndarray:
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    if qvel is not None:
        data.qvel[:] = qvel
    data.ctrl[:] = control
    settle_actuators(model, data, control)
    signature = mujoco.mjtState.mjSTATE_INTEGRATION.value
    state = np.empty(mujoco.mj_stateSize(model, signature))
    mujoco.mj_getState(model, data, state, signature)
    return state


def settle_actuators(model: mujoco.MjModel, data: mujoco.MjData, control: np.ndarray) -> None:
    """Fills delay buffers and filter states as if `control` (nu,) had been held for ever."""
    for actuator in range(model.nu):
        samples = int(model.actuator_history[actuator, 0])
        if samples:
            times = data.time + (np.arange(samples) - samples) * model.opt.timestep
            mujoco.mj_initCtrlHistory(model, data, actuator, times, np.full(samples, control[actuator]))
        activation = int(model.actuator_actadr[actuator])
        kind = model.actuator_dyntype[actuator]
        ramped = kind == mujoco.mjtDyn.mjDYN_PID and model.actuator_dynprm[actuator, 1] > 0.0
        if activation >= 0 and (kind in _FILTERS or ramped):
            data.act[activation] = control[actuator]


_FILTERS = (mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)


def _blank_after_stop(positions: np.ndarray, time_s: np.ndarray, step_s: float) -> None:
    # a stopped simulation repeats its last record, so its clock stands still
    stopped = np.flatnonzero(np.diff(time_s, prepend=-step_s) < 0.5 * step_s)
    positions[1 + (stopped[0] if stopped.size else len(time_s) - 1) :] = np.nan
