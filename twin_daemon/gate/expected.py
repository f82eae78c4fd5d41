"""Where the hand should be by now: the twin, driven by what was sent from where the hand was when that began."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from twin_daemon.gate.limits import Limits
from twin_daemon.simulation.rollout import settle_actuators
from twin_daemon.simulation.twin import TwinModel

_COARSEST_STEP_S = 0.008  # a lag is wanted to a third, not to a part in a thousand
_LONGEST_TURN_S = 0.1
_TRIED_STEPS = 40
_MOST_KEPT = 64
_WARNINGS = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


class Expected:
    """A rollout beside the hand, one step or a few a turn. It never looks at the hand again once it has begun: what
    holds the hand back must not hold back what it is measured against.

    `reading` (c,) is what the sensors of each command should read, rad; NaN before it begins and if the model fails.
    """

    def __init__(self, twin: TwinModel, limits: Limits, period_s: float) -> None:
        coarse = twin.at_step(period_s / math.ceil(period_s / _COARSEST_STEP_S))
        self._twin = coarse if _is_stable(coarse.model) else twin
        self._model = self._twin.model
        self._data = mujoco.MjData(self._model)
        self._ctrl, self._qpos = self._data.ctrl, self._data.qpos  # views, as below
        numbers = self._data.warning.number  # a view: to ask for it costs as much as to look at it
        self._failed = numbers[int(_WARNINGS[0]) : int(_WARNINGS[-1]) + 1]
        self._step_s = float(self._model.opt.timestep)
        self._mapping, self._driven = self._twin.command_map(limits.names)
        self._gain, self._offset_rad = self._twin.measurement.factors(twin.joints)
        parts = [[twin.joints.index(j) for j in info.joints] for info in twin.hand.description.commands.values()]
        self._parts = np.array([joint for joints in parts for joint in joints], dtype=int)
        self._firsts = np.cumsum([0, *map(len, parts[:-1])])
        self._of_part = np.repeat(np.arange(len(parts)), [len(joints) for joints in parts])
        self._told: dict[bytes, np.ndarray] = {}
        self.forget()

    def forget(self) -> None:
        """Nothing is sent, and nothing expected."""
        self.running = False
        self._due_s = 0.0
        self.reading = np.full(len(self._firsts), np.nan)

    def begin(self, pose: np.ndarray, start: np.ndarray) -> None:
        """From the measured `pose` (j,) rad at rest, held at `start` (c,) rad. NaN: at the model's own rest."""
        model, data, twin = self._model, self._data, self._twin
        mujoco.mj_resetData(model, data)
        held = self._mapping @ np.where(np.isfinite(start), start, 0.0)
        data.qpos[:] = twin.initial_qpos(twin.measurement.invert(twin.joints, pose), held)
        data.ctrl[:] = np.where(self._driven, held, data.ctrl)
        settle_actuators(model, data, data.ctrl)
        self._due_s = 0.0
        self.running = True
        self._read()

    def place(self, fresh: np.ndarray, pose: np.ndarray, start: np.ndarray) -> None:
        """Commands `fresh` (c,) bool, which were not driven yet, begin now, where their joints are measured."""
        data, twin = self._data, self._twin
        joints = self._parts[fresh[self._of_part]]
        angle = data.qpos[twin.qpos_adr]
        angle[joints] = twin.measurement.invert(twin.joints, pose)[joints]
        self._control(np.where(fresh, start, np.nan))
        data.qpos[:] = twin.initial_qpos(angle, data.ctrl[: len(self._mapping)])
        data.qvel[twin.dof_adr[joints]] = 0.0
        self._read()

    def advance(self, setpoint: np.ndarray, dt_s: float) -> None:
        """Goes on by `dt_s` with the setpoints (c,) in force; NaN keeps what there was."""
        if not self.running:
            return
        self._control(setpoint)
        self._due_s = min(self._due_s + dt_s, _LONGEST_TURN_S)
        steps = int(self._due_s / self._step_s + 1e-6)
        if steps:
            self._due_s -= steps * self._step_s
            mujoco.mj_step(self._model, self._data, nstep=steps)
        if np.count_nonzero(self._failed):
            self.forget()
        else:
            self._read()

    def _control(self, setpoint: np.ndarray) -> None:
        given = np.isfinite(setpoint)
        which = given.tobytes()
        told = self._told.get(which)
        if told is None:
            if len(self._told) >= _MOST_KEPT:
                self._told.clear()
            told = self._told[which] = self._driven & ~self._mapping[:, ~given].any(axis=1)
        np.copyto(self._ctrl, self._mapping @ np.where(given, setpoint, 0.0), where=told)

    def _read(self) -> None:
        angle = self._qpos[self._twin.qpos_adr]
        reading = angle * self._gain + self._offset_rad + self._twin.measurement.added(self._twin.joints, angle)
        self.reading = np.add.reduceat(reading[self._parts], self._firsts)


def _is_stable(model: mujoco.MjModel) -> bool:
    """Whether the servos of a model bear its step: from rest each is sent a part of its range away and back."""
    data = mujoco.MjData(model)
    limited = model.actuator_ctrllimited.astype(bool)
    high = np.where(limited, model.actuator_ctrlrange[:, 1], 0.5)
    for part in (0.3, 0.0):
        data.ctrl[:] = part * high
        mujoco.mj_step(model, data, nstep=_TRIED_STEPS)
    calm = not any(data.warning[kind].number for kind in _WARNINGS) and np.isfinite(data.qpos).all()
    return bool(calm) and float(np.abs(data.qvel).max(initial=0.0)) < 100.0
