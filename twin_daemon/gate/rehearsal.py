"""A motion tried on the twin before the hand does it: how hard the motors pull, how far the hand stays behind."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from twin_daemon.gate.limits import Limits
from twin_daemon.gate.motion import Motion, shaped
from twin_daemon.simulation.rollout import settle_actuators
from twin_daemon.simulation.touches import touches
from twin_daemon.simulation.twin import TwinModel

_SETTLE_S = 0.5


def rehearse(
    twin: TwinModel, limits: Limits, begin: np.ndarray, measured: np.ndarray, motion: Motion
) -> dict[str, Any]:
    """The twin driven as the hand would be, from the measured pose (j,) rad and setpoints `begin` (c,).

    Gives the time in s, the peak effort of each motor that is moved (its unit: N m, or N of a tendon) and its share
    of what the motor can give, the greatest tracking error in rad, and the touches that last.
    """
    model, data = twin.model, mujoco.MjData(twin.model)
    mapping, driven = twin.command_map(limits.names)
    steps = max(1, round(motion.dt_s / model.opt.timestep))
    held = np.where(np.isfinite(begin), begin, 0.0)
    data.qpos[:] = twin.initial_qpos(twin.measurement.invert(twin.joints, measured), mapping @ held)
    data.ctrl[: len(mapping)] = mapping @ held
    settle_actuators(model, data, data.ctrl)
    effort = np.zeros(model.nu)
    error = np.zeros(len(limits.names))
    touched: set[tuple[str, str]] = set()
    duration_s = 0.0
    rows = list(shaped(limits, begin, motion))
    for number in range(len(rows) + int(_SETTLE_S / motion.dt_s)):
        row = np.where(motion.moved, rows[min(number, len(rows) - 1)], held)
        data.ctrl[: len(mapping)] = np.where(driven, mapping @ row, data.ctrl[: len(mapping)])
        mujoco.mj_step(model, data, nstep=steps)
        effort = np.maximum(effort, np.abs(data.actuator_force))
        length = data.actuator_length[: len(mapping)]
        away = np.abs(data.ctrl[: len(mapping)] - length)
        error = np.maximum(error, np.where(motion.moved, mapping.T @ np.where(driven, away, 0.0), 0.0))
        for touch in touches(model, data):
            if touch.distance_m < 0.0:
                first, second = sorted(model.body(body).name for body in touch.bodies)
                touched.add((first, second))
        duration_s += motion.dt_s
    moved = [i for i in range(len(mapping)) if mapping[i, motion.moved].any()]
    names = [limits.names[int(np.argmax(mapping[i]))] for i in moved]
    most = [float(model.actuator_forcerange[i, 1]) if model.actuator_forcelimited[i] else np.inf for i in moved]
    return {
        "duration_s": duration_s - _SETTLE_S,
        "peak_effort": {name: float(effort[i]) for name, i in zip(names, moved, strict=True)},
        "peak_effort_share": {
            name: float(effort[i] / top) if np.isfinite(top) and top > 0.0 else None
            for name, i, top in zip(names, moved, most, strict=True)
        },
        "tracking_error_rad": {
            name: float(error[limits.names.index(name)])
            for name in limits.names
            if motion.moved[limits.names.index(name)]
        },
        "touches": sorted([list(pair) for pair in touched]),
        "finite": bool(np.isfinite(data.qpos).all()),
    }
