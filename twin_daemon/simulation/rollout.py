"""The one roll-out function: many models driven by many command sequences, on all cores.

Runs on `mujoco.batch`, whose results are bit-identical to a plain mj_step loop at any number of threads.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np
from mujoco import batch

from twin_daemon.processor_time import thread_count
from twin_daemon.simulation.motors import motors, settle_motors
from twin_daemon.simulation.turns import Bent

# A chunk of simulations keeps its controls and positions in memory at once; this bounds both.
_CHUNK_BYTES = 256 * 2**20
# as components of the state: recording a field by its name costs a simulation's data more
_TIME = mujoco.mjtState.mjSTATE_TIME.value
_QPOS = mujoco.mjtState.mjSTATE_QPOS.value
_QVEL = mujoco.mjtState.mjSTATE_QVEL.value
_CTRL = mujoco.mjtState.mjSTATE_CTRL.value
_APPLIED = mujoco.mjtState.mjSTATE_QFRC_APPLIED.value
_WHOLE = mujoco.mjtState.mjSTATE_INTEGRATION.value


def _without_timers() -> None:
    """Takes away the clock that MuJoCo's bindings install, as its C library comes without one.

    Reading it at every stage of every step is a third of a small model's roll-out, and nothing here looks at
    `MjData.timer`. No motion depends on it. `set_mjcb_time(None)` would only put the bindings' own clock back.
    """
    for library in Path(mujoco.__file__).parent.glob("*mujoco*.*"):
        if library.name.endswith((".dylib", ".dll")) or ".so" in library.suffixes:
            with contextlib.suppress(OSError, ValueError):  # ValueError: this library has no such callback
                ctypes.c_void_p.in_dll(ctypes.CDLL(str(library)), "mjcb_time").value = None


_without_timers()


def roll_out(
    models: Sequence[mujoco.MjModel],
    controls: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray | None = None,
    *,
    before: np.ndarray | None = None,
    applied: np.ndarray | None = None,
    loaded: bool = False,
    turns: Mapping[int, Bent] | None = None,
    threads: int | None = None,
) -> np.ndarray:
    """Positions of every simulation, (B, T + 1, nq), the initial state first.

    `models` has B models of the same sizes, or one for all. `controls` is (B or 1, T, nu): row k is applied
    during step k; actuators beyond its columns get 0. `qpos` is (B or 1, nq), `qvel` (B or 1, nv), zero where
    not given. `applied` (B or 1, T, nv) are generalised forces beside those of the actuators. Delay buffers
    and filters start as `before` (B or 1, H, nu), the controls of the steps before, has left them; without it as if
    the hand had been told the first control for ever. With `loaded` motors behind a transmission begin where they
    carry their load, and bristles of dry friction bent by what they hold, or by the motion before as far as `turns`
    says for a degree of freedom; without it they begin relaxed, and motors where `qpos` says. From the step at which
    MuJoCo warns (a state that is not finite or diverges) a simulation's positions are NaN.
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
    # without anything that remembers a state is its position, velocity and control: an MjData costs more than they do
    plain = not remembers(first) and not motors(first) and not (loaded and _bristles(first).size)
    kept = None if plain else mujoco.MjData(first)
    fresh, places = runner.state[0].copy(), [place_in_state(first, component) for component in (_QPOS, _QVEL, _CTRL)]
    for start in range(0, count, chunk):
        chosen = range(start, min(start + chunk, count))
        ids = np.arange(len(chosen), dtype=np.int32)
        picked = [models[i if len(models) > 1 else 0] for i in chosen]
        if len(models) > 1:
            runner.set_models([*picked, *[first] * (chunk - len(picked))])
        for slot, i in enumerate(chosen):
            control, position = controls[_row(i, controls)][0], qpos[_row(i, qpos)]
            velocity = np.zeros(first.nv) if qvel is None else qvel[_row(i, qvel)]
            if kept is None:
                runner.state[slot] = fresh
                for place, values in zip(places, (position, velocity, control), strict=True):
                    runner.state[slot, place] = values
            else:
                told = None if before is None else before[_row(i, before)]
                runner.state[slot] = initial_state(
                    picked[slot], kept, control, position, velocity, told, loaded=loaded, turns=turns
                )
        runner.warning[:] = 0
        rows, inputs = controls[start : start + len(chosen)] if len(controls) > 1 else controls, _CTRL
        if applied is not None:
            forces = applied[start : start + len(chosen)] if len(applied) > 1 else applied
            count_rows = max(len(rows), len(forces))
            both = [np.broadcast_to(part, (count_rows, *part.shape[1:])) for part in (rows, forces)]
            rows, inputs = np.concatenate(both, axis=2), _CTRL | _APPLIED
        recorded = runner.rollout(steps, rows, inputs, record=(_QPOS, _TIME), ids=ids)
        for slot, i in enumerate(chosen):
            out[i, 0] = qpos[_row(i, qpos)]
            out[i, 1:] = recorded[_QPOS][slot]
            if runner.warning[slot].any():
                _blank_after_stop(out[i], recorded[_TIME][slot, :, 0], first.opt.timestep)
    return out


def _row(index: int, array: np.ndarray) -> int:
    return index if len(array) > 1 else 0


def initial_state(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    control: np.ndarray,
    qpos: np.ndarray,
    qvel: np.ndarray,
    before: np.ndarray | None,
    *,
    loaded: bool,
    turns: Mapping[int, Bent] | None = None,
) -> np.ndarray:
    """The whole state with which a roll-out begins, as `roll_out` explains it.

    `data` is of any model of the same sizes, and overwritten: to make one anew for each state costs more than all else.
    """
    mujoco.mj_resetData(model, data)
    data.qpos[:] = qpos
    data.qvel[:] = qvel
    data.ctrl[:] = control
    settle_actuators(model, data, control)
    if before is not None:
        recall_commands(model, data, before)
    if loaded:
        settle_motors(model, data)
        settle_bristles(model, data, turns or {})
    state = np.empty(mujoco.mj_stateSize(model, _WHOLE))
    mujoco.mj_getState(model, data, state, _WHOLE)
    return state


def place_in_state(model: mujoco.MjModel, component: int) -> slice:
    """Where one component is in a state: components follow each other in the order of their bits."""
    begin = mujoco.mj_stateSize(model, _WHOLE & (component - 1))
    return slice(begin, begin + mujoco.mj_stateSize(model, component))


def settle_actuators(model: mujoco.MjModel, data: mujoco.MjData, control: np.ndarray) -> None:
    """Fills delay buffers and filter states as if `control` (nu,) had been held for ever."""
    for actuator in _late(model):
        samples = int(model.actuator_history[actuator, 0])
        times = data.time + (np.arange(samples) - samples) * model.opt.timestep
        mujoco.mj_initCtrlHistory(model, data, actuator, times, np.full(samples, control[actuator]))
    followers = _followers(model)
    data.act[model.actuator_actadr[followers]] = control[followers]


def remembers(model: mujoco.MjModel) -> bool:
    """Whether any actuator's state depends on the commands before: a delay, a filter, a limit of rate."""
    return _late(model).size > 0 or _followers(model).size > 0


def never_forgets(model: mujoco.MjModel) -> bool:
    """Whether an actuator may depend on all commands: behind a limit of rate the set point may never arrive."""
    return bool((~_filters(model.actuator_dyntype[_followers(model)])).any())


def recall_commands(model: mujoco.MjModel, data: mujoco.MjData, before: np.ndarray) -> None:
    """Brings delay buffers, filters and rate limits to where the commands of the steps before (H, nu) left them."""
    step_s = float(model.opt.timestep)
    for actuator in _late(model):
        told, samples = before[:, actuator], int(model.actuator_history[actuator, 0])
        padded = np.concatenate([np.full(max(samples - len(told), 0), told[0]), told])[-samples:]
        times = data.time + (np.arange(samples) - samples) * step_s
        mujoco.mj_initCtrlHistory(model, data, actuator, times, padded)
    for actuator in _followers(model):
        told = before[:, actuator]
        late = round(float(model.actuator_delay[actuator]) / step_s) if model.actuator_history[actuator, 0] else 0
        told = np.concatenate([np.full(late, told[0]), told])[: len(told)]
        state = float(told[0])
        if model.actuator_dyntype[actuator] in (_FILTER, _FILTEREXACT):
            kept = np.exp(-step_s / max(float(model.actuator_dynprm[actuator, 0]), 1e-12))
            ages = np.arange(len(told) - 1, -1, -1)
            state = float(state * kept ** len(told) + (1.0 - kept) * (told @ kept**ages))
        else:
            most = float(model.actuator_dynprm[actuator, 1]) * step_s
            for target in told.tolist():
                state += min(max(target - state, -most), most)
        data.act[model.actuator_actadr[actuator]] = state


def _late(model: mujoco.MjModel) -> np.ndarray:
    """The actuators whose commands wait in a buffer."""
    return np.flatnonzero(model.actuator_history[:, 0] > 0)


def _followers(model: mujoco.MjModel) -> np.ndarray:
    """The actuators with an activation that follows their command."""
    kind = model.actuator_dyntype
    ramped = (kind == _PID) & (model.actuator_dynprm[:, 1] > 0.0)
    return np.flatnonzero((model.actuator_actadr >= 0) & (_filters(kind) | ramped))


def _filters(kind: np.ndarray) -> np.ndarray:
    return (kind == _FILTER) | (kind == _FILTEREXACT)


def settle_bristles(model: mujoco.MjModel, data: mujoco.MjData, turns: Mapping[int, Bent]) -> None:
    """Bends the bristles of LuGre friction as the motion before has left them.

    Where `turns` knows that motion for a degree of freedom it says how far. Else they hold what nothing else does where
    a hand stands still, and are bent as far as they go where it moves. Without this every roll-out would begin with a
    creep.
    """
    bristles = _bristles(model)
    if not bristles.size:
        return
    mujoco.mj_forward(model, data)
    net = data.qfrc_actuator + data.qfrc_passive - data.qfrc_bias
    for actuator in bristles:
        dof = int(model.jnt_dofadr[model.actuator_trnid[actuator, 0]])
        stiffness, most = float(model.actuator_dynprm[actuator, 5]), float(model.actuator_biasprm[actuator, 4])
        sliding = float(model.actuator_biasprm[actuator, 3])
        share = turns[dof](sliding / stiffness) if dof in turns else None
        if share is not None:
            load = share * sliding
        elif abs(data.qvel[dof]) * _FULLY_S > sliding / stiffness:
            load = np.sign(data.qvel[dof]) * sliding
        else:
            load = np.clip(net[dof], -most, most)
        data.act[model.actuator_actadr[actuator]] = load / stiffness


def _bristles(model: mujoco.MjModel) -> np.ndarray:
    """The actuators that are dry friction with bristles."""
    at_joint = (model.actuator_trntype == _JOINT) & (model.actuator_actadr >= 0)
    return np.flatnonzero((model.actuator_dyntype == _DCMOTOR) & (model.actuator_dynprm[:, 5] > 0.0) & at_joint)


_FULLY_S = 0.1  # a bristle that gives way sooner at this speed is taken for bent as far as it goes
# as numbers: arrays are slow to compare with an enum of MuJoCo's
_FILTER, _FILTEREXACT = int(mujoco.mjtDyn.mjDYN_FILTER), int(mujoco.mjtDyn.mjDYN_FILTEREXACT)
_PID, _DCMOTOR = int(mujoco.mjtDyn.mjDYN_PID), int(mujoco.mjtDyn.mjDYN_DCMOTOR)
_JOINT = int(mujoco.mjtTrn.mjTRN_JOINT)


def _blank_after_stop(positions: np.ndarray, time_s: np.ndarray, step_s: float) -> None:
    # a stopped simulation repeats its last record, so its clock stands still
    stopped = np.flatnonzero(np.diff(time_s, prepend=-step_s) < 0.5 * step_s)
    positions[1 + (stopped[0] if stopped.size else len(time_s) - 1) :] = np.nan
