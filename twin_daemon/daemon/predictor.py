"""The model runs beside the hand: driven by the commands that the hand gets, anchored to what it measures."""

from __future__ import annotations

import bisect
from collections import Counter
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

from twin_daemon.daemon.messages import JointSample
from twin_daemon.simulation.rollout import settle_actuators
from twin_daemon.simulation.touches import dofs_that_move
from twin_daemon.simulation.twin import TwinModel

State = Literal["waiting", "no_commands", "following"]
_MAX_PENDING = 2000
_MAX_LAYOUTS = 64
_FURTHEST_AHEAD_NS = 1_000_000_000
_WARNINGS = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)


@dataclass(frozen=True)
class Prediction:
    """The model at one stamp: what the sensors should read, (j,) rad, and joint velocities (j,) rad/s.

    `touched` (j,) says which joints a contact has loaded since the model last started from the measurement.
    `anchored` names the reason where the model was set to the measurement at this very stamp because it could not
    be carried on; such a prediction is the measurement itself and says nothing about the model.
    """

    stamp_ns: int
    position: np.ndarray
    velocity: np.ndarray
    touched: np.ndarray
    anchored: str | None = None


class Predictor:
    """A free-running model with bounded work per sample.

    It is set to the measurement at the start, after a gap longer than `max_catch_up_s`, when MuJoCo reports that it
    diverged, and each time it has run free for `horizon_s`. Between two steps the position is extended along its
    velocity, so that stamps need not fall on steps. Until a first command arrives the measured pose is the target.
    """

    def __init__(self, twin: TwinModel, horizon_s: float = 2.0, max_catch_up_s: float = 0.5) -> None:
        self.twin = twin
        self.anchors: Counter[str] = Counter()
        self.steps = 0
        self.anchored_ns: int | None = None
        self.anchor_reason: str | None = None
        self._step_ns = max(1, round(twin.model.opt.timestep * 1e9))
        self.retime(horizon_s, max_catch_up_s)
        self._data = mujoco.MjData(twin.model)
        self._qpos, self._qvel = self._data.qpos, self._data.qvel
        self._warnings = [self._data.warning[kind] for kind in _WARNINGS]
        self._gain, self._offset_rad = twin.measurement.factors(twin.joints)
        self._now_ns = 0
        self._commanded = np.zeros(twin.model.nu, dtype=bool)
        self._control = np.zeros(twin.model.nu)
        self._pending: list[tuple[int, np.ndarray, np.ndarray]] = []
        self._layouts: dict[tuple[str, ...], tuple[np.ndarray, np.ndarray]] = {}
        self._hold_map, self._held = twin.command_map(twin.joints)
        self._moves = _joints_that_move(twin, self._hold_map != 0.0)
        self._touched = np.zeros(len(twin.joints), dtype=bool)

    def retime(self, horizon_s: float, max_catch_up_s: float) -> None:
        """How long it runs free, and what it catches up with, from now on."""
        self._horizon_ns = int(horizon_s * 1e9)
        self._max_steps = max(1, int(max_catch_up_s * 1e9) // self._step_ns)

    @property
    def state(self) -> State:
        if self.anchored_ns is None:
            return "waiting"
        return "following" if self._commanded.any() else "no_commands"

    @property
    def targets_rad(self) -> dict[str, float]:
        """The target of each command that was ever given."""
        return {str(name): float(self._control[i]) for i, name in enumerate(self.twin.actuators) if self._commanded[i]}

    def lag_s(self, stamp_ns: int) -> float:
        """How far the model is behind a stamp."""
        return (stamp_ns - self._now_ns) * 1e-9

    # -- commands ------------------------------------------------------------------------------------------

    def command(self, stamp_ns: int, names: tuple[str, ...], position: np.ndarray) -> bool:
        """Targets (k,) rad that hold from `stamp_ns` on; NaN says nothing. False if they drive nothing here."""
        control, determined = self._controls(names, np.asarray(position, float))
        if not determined.any():
            return False
        if self.anchored_ns is None and stamp_ns == 0:
            self._take(control, determined)
            return True
        bisect.insort(self._pending, (stamp_ns, control, determined), key=lambda entry: entry[0])
        if len(self._pending) > _MAX_PENDING:
            self._take(*self._pending.pop(0)[1:])
        return True

    def _controls(self, names: tuple[str, ...], position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        layout = self._layouts.get(names)
        if layout is None:
            if len(self._layouts) >= _MAX_LAYOUTS:
                self._layouts.clear()
            layout = self._layouts[names] = self.twin.command_map(names)
        mapping, determined = layout
        finite = np.isfinite(position)
        # an actuator that needs a target which is not there stays where it is
        determined = determined & ~mapping[:, ~finite].any(axis=1)
        return mapping @ np.where(finite, position, 0.0), determined

    def _take(self, control: np.ndarray, determined: np.ndarray) -> None:
        self._control[determined] = control[determined]
        self._commanded |= determined

    # -- time ----------------------------------------------------------------------------------------------

    def advance(self, stamp_ns: int, position: np.ndarray, velocity: np.ndarray) -> Prediction:
        """Runs the model to `stamp_ns` and predicts; `position` and `velocity` (j,) are what was measured there."""
        if self.anchored_ns is None:
            return self._set(stamp_ns, position, velocity, "start")
        due = (stamp_ns - self._now_ns) // self._step_ns
        if due < 0 or due > self._max_steps:
            return self._set(stamp_ns, position, velocity, "gap")
        if not self._run(int(due)):
            return self._set(stamp_ns, position, velocity, "diverged")
        predicted = self._read(stamp_ns)
        if stamp_ns - self.anchored_ns >= self._horizon_ns:
            self._anchor(stamp_ns, position, velocity, "horizon")
        return predicted

    def restart(self) -> None:
        """Forgets the anchor and all pending commands; the next sample is a new start."""
        self.anchored_ns = None
        self._pending.clear()

    def inherit(self, other: Predictor) -> None:
        """Takes over from another model: the targets that are known or to come, and the count of anchors so far."""
        names, targets = tuple(other.targets_rad), np.array(list(other.targets_rad.values()))
        if names:
            self.command(0, names, targets)
        if len(other._control) == len(self._control):
            self._pending = list(other._pending)  # commands that are on their way hold for this model as well
        self.anchors.update(other.anchors)
        self.steps = other.steps

    def _run(self, steps: int) -> bool:
        end_ns = self._now_ns + steps * self._step_ns
        model, data = self.twin.model, self._data
        while self._now_ns < end_ns:
            while self._pending and self._pending[0][0] <= self._now_ns:
                self._take(*self._pending.pop(0)[1:])
            until_ns = min(end_ns, self._pending[0][0]) if self._pending else end_ns
            count = max(1, -(-(until_ns - self._now_ns) // self._step_ns))
            data.ctrl[:] = self._control
            mujoco.mj_step(model, data, nstep=count)
            self._now_ns += count * self._step_ns
            self.steps += count
        if data.ncon:
            self._note_contacts()
        return not any(warning.number for warning in self._warnings)

    def _note_contacts(self) -> None:
        """A contact loads the joints that move one of its bodies and not the other."""
        geoms = self._data.contact.geom
        first, second = self.twin.model.geom_bodyid[geoms[geoms.min(axis=1) >= 0]].T
        self._touched |= (self._moves[first] ^ self._moves[second]).any(axis=0)

    def _read(self, stamp_ns: int) -> Prediction:
        ahead_s = (stamp_ns - self._now_ns) * 1e-9
        velocity = self._qvel[self.twin.dof_adr]
        angle = self._qpos[self.twin.qpos_adr] + ahead_s * velocity
        reading = angle * self._gain + self._offset_rad + self.twin.measurement.added(self.twin.joints, angle)
        return Prediction(stamp_ns, reading, velocity, self._touched.copy())

    # -- anchors -------------------------------------------------------------------------------------------

    def _set(self, stamp_ns: int, position: np.ndarray, velocity: np.ndarray, reason: str) -> Prediction:
        """A new beginning: nothing of the model's past is kept but the targets."""
        mujoco.mj_resetData(self.twin.model, self._data)
        self._pending, given = [], self._pending
        for entry in given:
            # before the first state nothing says whose clock a command bears: one far ahead holds at once
            if stamp_ns < entry[0] <= stamp_ns + _FURTHEST_AHEAD_NS:
                self._pending.append(entry)
            else:
                self._take(*entry[1:])
        self._anchor(stamp_ns, position, velocity, reason)
        settle_actuators(self.twin.model, self._data, self._control)
        measured = np.array(position, float), np.array(velocity, float)
        return Prediction(stamp_ns, *measured, self._touched.copy(), anchored=reason)

    def _anchor(self, stamp_ns: int, position: np.ndarray, velocity: np.ndarray, reason: str) -> None:
        """Joints go to the measured angles; filters and delay lines keep what they hold."""
        angle = self.twin.measurement.invert(self.twin.joints, np.asarray(position, float))
        known = np.isfinite(angle)
        self._qpos[self.twin.qpos_adr[known]] = angle[known]
        self._qvel[self.twin.dof_adr] = np.where(known & np.isfinite(velocity), velocity, 0.0)
        pose = np.where(known, angle, self._qpos[self.twin.qpos_adr])
        hold = self._held & ~self._commanded
        self._control[hold] = (self._hold_map @ pose)[hold]
        self._data.ctrl[:] = self._control
        self._touched[:] = False
        self._now_ns = stamp_ns
        self.anchored_ns = stamp_ns
        self.anchor_reason = reason
        self.anchors[reason] += 1


def _joints_that_move(twin: TwinModel, driven: np.ndarray) -> np.ndarray:
    """(nbody, j) the joints that move a body, with those that share an actuator with one of them.

    `driven` (nu, j) says what each actuator moves: what holds up J2 holds up J1 of its tendon as well.
    """
    moves = dofs_that_move(twin.model)[:, twin.dof_adr]
    return moves | ((moves @ driven.T.astype(int)) @ driven.astype(int) > 0)


def as_sample(prediction: Prediction, joints: tuple[str, ...]) -> JointSample:
    """The prediction as a joint state."""
    return JointSample(prediction.stamp_ns, joints, prediction.position, prediction.velocity)
