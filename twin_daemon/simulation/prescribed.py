"""What joints outside a sub-model do to it while they move: torques that make it move as in the whole robot.

A sub-model welds the joints that it leaves out, but in the recording these move: a wrist carries moving fingers. Along
the measured motion the torque that the whole robot needs and the one that the sub-model needs are known from inverse
dynamics; their difference is what the joints outside do (Featherstone 2008, chapter 5). Applied to the sub-model it is
exact on the measured motion; off it by some milliradians the error is of second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.polynomial import Polynomial
from scipy.signal import oaconvolve, savgol_coeffs

from twin_daemon.effects.base import Measurement
from twin_daemon.simulation.alignment import Aligned, predict
from twin_daemon.simulation.reactions import Blocks, Reaction
from twin_daemon.simulation.twin import TwinModel

_CELL_S = 0.002  # that torques are averaged over: over twice that a 50 Hz arm is left with twice the floor
_LEAST_WINDOW = 5
_FINER = 4  # times the model's own step: what that gets wrong of an acceleration is a load on the neighbours
_DOUBLED = 5  # times that the shortest window of an average may be doubled
_SHIFTS = 8  # linear steps to the delay of a prediction: three are enough where it is less than a servo's time
_LEAST_MISSED = 1e-16  # rad^2


@dataclass(frozen=True)
class Motion:
    """Smooth motion of all joints along a recording, in m cells of time one after another, `time_s` (m,) their middles.

    `position`, `velocity`, `acceleration` (m, j) are means over a cell: a pulse that is shorter keeps its impulse.
    """

    time_s: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray

    def at(self, rows: slice) -> Motion:
        """The motion at some of its times."""
        return Motion(self.time_s[rows], self.position[rows], self.velocity[rows], self.acceleration[rows])


def measured_motion(twin: TwinModel, recording: Aligned, stirring: np.ndarray) -> Motion:
    """The measured motion with its derivatives: the twin's prediction, moved smoothly to where the joints were.

    Joints that are not `stirring` (j,) stay at their mean: what is read of them is noise.

    The prediction has the sharp beginnings of commanded steps; what it misses is smoother and can be averaged over the
    time that each servo takes. Differentiating readings twice would amplify their noise instead. What all joints do
    later than predicted is the commands' delay, and not smooth: the prediction is moved by it first.
    """
    step_s = float(twin.model.opt.timestep)
    period = float(np.median(np.diff(recording.time_s)))
    finest_s, each = step_s / _FINER, _FINER * max(1, round(_CELL_S / step_s))
    dt = each * finest_s
    cells = int(np.ceil((recording.time_s[-1] + step_s) / dt))
    fine_s = np.arange(cells * each + 1) * finest_s
    predicted = predict(twin.at_step(finest_s), replace(recording, time_s=fine_s))
    predicted = twin.measurement.invert(twin.joints, predicted)
    if not np.isfinite(predicted).all():
        predicted = np.zeros_like(predicted)
    measured = twin.measurement.invert(twin.joints, recording.states)
    predicted = _later(predicted, fine_s, recording.time_s, measured)
    at_edges, speed_at_edges = predicted[::each], np.gradient(predicted, finest_s, axis=0)[::each]
    own = 0.5 * (at_edges[1:] + at_edges[:-1]), np.diff(at_edges, axis=0) / dt, np.diff(speed_at_edges, axis=0) / dt
    grid = (np.arange(cells) + 0.5) * dt
    position = np.empty((3, cells, len(twin.joints)))
    for joint in range(len(twin.joints)):
        column = measured[:, joint]
        known = np.isfinite(column)
        if not known.any() or not stirring[joint]:
            still = float(np.nanmean(column)) if known.any() else float(twin.model.qpos0[twin.qpos_adr[joint]])
            position[:, :, joint] = np.array([still, 0.0, 0.0])[:, None]
            continue
        read_s = recording.time_s[known]
        beyond = column[known] - np.interp(read_s, fine_s, predicted[:, joint])
        missed = np.interp(grid, read_s, beyond)
        least_s = 2.0 * max(response_time_s(twin, twin.joints[joint]), _LEAST_WINDOW * period)
        window_s = _window_s(read_s, beyond, grid, least_s)
        samples = min(2 * int(0.5 * window_s / dt) + 1, 2 * ((len(grid) - 1) // 2) - 1)
        for order in range(3):
            position[order, :, joint] = own[order][:, joint]
            if samples >= 5:
                position[order, :, joint] += _smoothed(missed, samples, order, dt)
        if samples < 5:
            position[0, :, joint] += missed
    return Motion(grid, *position)


def _smoothed(values: np.ndarray, samples: int, order: int, step_s: float) -> np.ndarray:
    """(m,) a derivative of values (m,) by the cubics that are nearest to `samples` of them about each.

    As `scipy.signal.savgol_filter`, whose cost grows with the window: here it spans thousands of values.
    """
    half = samples // 2
    inside = oaconvolve(values, savgol_coeffs(samples, 3, deriv=order, delta=step_s), "valid")
    time_s = (np.arange(samples) - half) * step_s
    begin, end = (Polynomial.fit(time_s, part, 3).deriv(order) for part in (values[:samples], values[-samples:]))
    return np.concatenate([begin(time_s[:half]), inside, end(time_s[half + 1 :])])


def _window_s(time_s: np.ndarray, missed: np.ndarray, grid: np.ndarray, least_s: float) -> float:
    """s: over how long what a prediction misses (n,) at times (n,) is averaged: the best for readings left out.

    Each half of the readings, every second one, is told by the other half. A prediction that is right misses nothing
    but noise, and the longer the average the less of that is differentiated twice.
    """
    step_s = float(np.median(np.diff(time_s)))
    even = np.arange(time_s[0], time_s[-1], step_s)
    lengths = [2 * int(0.5 * least_s * 2**doubled / step_s) + 1 for doubled in range(_DOUBLED + 1)]
    lengths = [samples for samples in lengths if 5 <= samples < len(even) // 2]
    if len(lengths) < 2:
        return least_s
    # all are judged where the longest has readings on both sides
    inside = np.abs(time_s - 0.5 * (even[0] + even[-1])) < 0.5 * (even[-1] - even[0] - lengths[-1] * step_s)
    sizes = np.zeros(len(lengths))
    for first in (0, 1):
        told = np.interp(even, time_s[first::2], missed[first::2])
        judged = inside & (np.arange(len(time_s)) % 2 != first)
        for row, samples in enumerate(lengths):
            smooth = oaconvolve(told, savgol_coeffs(samples, 3), "same")
            sizes[row] += ((np.interp(time_s[judged], even, smooth) - missed[judged]) ** 2).sum()
    return least_s * 2.0 ** int(np.argmin(sizes))


def _later(predicted: np.ndarray, grid: np.ndarray, time_s: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """(m, j) the prediction (m, j) at `grid` (m,) moved in time to where readings (n, j) at `time_s` (n,) are nearest.

    Least squares over all joints, each weighed by what the prediction misses of it; a shift that leaves more is none.
    """
    columns = np.flatnonzero(np.isfinite(measured).any(axis=0) & (np.ptp(predicted, axis=0) > 0.0))
    slopes = np.gradient(predicted, grid, axis=0)

    def missed(shift: float) -> np.ndarray:
        moved = [np.interp(time_s - shift, grid, predicted[:, column]) for column in columns]
        return measured[:, columns] - np.array(moved).T

    def size(residual: np.ndarray) -> np.ndarray:
        return np.maximum(np.nanmean((residual - np.nanmean(residual, axis=0)) ** 2, axis=0), _LEAST_MISSED)

    if not columns.size:
        return predicted
    shift, left = 0.0, missed(0.0)
    for _ in range(_SHIFTS):
        speed = np.array([np.interp(time_s - shift, grid, slopes[:, column]) for column in columns]).T
        weight = 1.0 / size(left)
        known = np.isfinite(left)
        power = float((np.where(known, speed**2, 0.0) * weight).sum())
        if not power > 0.0:
            break
        new = shift - float((np.where(known, left * speed, 0.0) * weight).sum()) / power
        after = missed(new)
        if np.log(size(after)).sum() >= np.log(size(left)).sum():
            break
        shift, left = new, after
    return np.array([np.interp(grid - shift, grid, column) for column in predicted.T]).T


def response_time_s(twin: TwinModel, joint: str) -> float:
    """How long a joint's servo takes to follow, s: from its damping and inertia over its stiffness."""
    scale = twin.scale(joint)
    stiffness = max(scale.kp, 1e-12)
    return float(max(scale.damping / stiffness, np.sqrt(scale.inertia / stiffness)))


@dataclass(frozen=True)
class Needed:
    """What a whole robot needs to move along a motion; computed once for all of its parts."""

    twin: TwinModel
    motion: Motion

    @cached_property
    def torque(self) -> Blocks:
        """(m, nv) generalised forces."""
        return Blocks(len(self.motion.time_s), self._computed)

    def computed(self) -> Needed:
        """The same with the torques along the whole motion: a block at a time is for who needs few."""
        self.torque(slice(0, len(self.motion.time_s)))
        return self

    def _computed(self, rows: slice) -> np.ndarray:
        return _inverse(self.twin, self.motion.at(rows), range(len(self.twin.joints)))


def reaction(needed: Needed, small: TwinModel) -> Reaction | None:
    """What the joints that `small` leaves out do to it along a motion of the whole; None where they are still."""
    outside = [index for index, joint in enumerate(needed.twin.joints) if joint not in small.joints]
    if not outside or not np.abs(needed.motion.velocity[:, outside]).max(initial=0.0) > 0.0:
        return None
    return Reaction.along(_Difference(needed, small))


@dataclass(frozen=True)
class _Difference:
    """What the whole robot needs less than the sub-model for the same motion."""

    needed: Needed
    small: TwinModel

    @property
    def time_s(self) -> np.ndarray:
        return self.needed.motion.time_s

    @property
    def joints(self) -> tuple[str, ...]:
        return self.small.joints

    @property
    def measurement(self) -> Measurement:
        return self.needed.twin.measurement

    @property
    def position(self) -> np.ndarray:
        """(m, k) of the sub-model's joints."""
        return self._own_position

    @cached_property
    def _own_position(self) -> np.ndarray:
        return self.needed.motion.position[:, self._inside]

    @property
    def _inside(self) -> list[int]:
        return [self.needed.twin.joints.index(joint) for joint in self.joints]

    def torque(self, rows: slice, moved: np.ndarray | None = None) -> np.ndarray:
        """(len(rows), k) N m; with the sub-model's joints (k,) elsewhere by so much all the time."""
        twin, motion = self.needed.twin, self.needed.motion.at(rows)
        if moved is None:
            whole = self.needed.torque(rows)
        else:
            position = motion.position.copy()
            position[:, self._inside] += moved
            motion = replace(motion, position=position)
            whole = _inverse(twin, motion, range(len(twin.joints)))
        own = [twin.dof_adr[index] for index in self._inside]
        return _inverse(self.small, motion, self._inside)[:, self.small.dof_adr] - whole[:, own]


def _inverse(twin: TwinModel, motion: Motion, columns: Sequence[int]) -> np.ndarray:
    """(m, nv) generalised forces that inertia and gravity ask for along a motion."""
    model = twin.model.__copy__()
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(
        off.mjDSBL_CONSTRAINT | off.mjDSBL_ACTUATION | off.mjDSBL_SPRING | off.mjDSBL_DAMPER | off.mjDSBL_CONTACT
    )
    data = mujoco.MjData(model)
    chosen, count = list(columns), len(motion.time_s)
    out = np.empty((count, model.nv))
    # laid out before the loop, which else takes three times as long as what it is there for
    qpos, qvel, qacc = np.tile(data.qpos, (count, 1)), np.zeros_like(out), np.zeros_like(out)
    qpos[:, twin.qpos_adr] = motion.position[:, chosen]
    qvel[:, twin.dof_adr] = motion.velocity[:, chosen]
    qacc[:, twin.dof_adr] = motion.acceleration[:, chosen]
    to_qpos, to_qvel, to_qacc, needed = data.qpos, data.qvel, data.qacc, data.qfrc_inverse
    for row in range(count):
        to_qpos[:], to_qvel[:], to_qacc[:] = qpos[row], qvel[row], qacc[row]
        mujoco.mj_inverse(model, data)
        out[row] = needed
    return out
