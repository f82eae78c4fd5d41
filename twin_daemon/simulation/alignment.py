"""A recording beside the commands that caused it, on one clock, ready for roll-outs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from twin_daemon.errors import BadInput
from twin_daemon.minimum import lowest
from twin_daemon.recordings.recording import Recording
from twin_daemon.recordings.sampling_clock import sample_times
from twin_daemon.signals.commands import CommandSignal
from twin_daemon.signals.trajectory import Trajectory
from twin_daemon.simulation.reactions import Reaction
from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.turns import Turns
from twin_daemon.simulation.twin import TwinModel

MOVING_RAD = 0.05
"""A joint moves where its measured travel exceeds this; stiller ones say nothing about a model."""

_TOLD_TIMES = 2.0  # as far: a joint that is told to go that far and stays where it is does not answer

_SETTLE_S = 0.04  # the first samples, from which the starting velocity is read
_FEWEST = 4  # of these samples: as many as a line needs that says how far it is off


@dataclass(frozen=True)
class Aligned:
    """One recording with its commands.

    `time_s` (n,) since the first sample; `measured` (n, j) rad in the order of `joints` (NaN where a sample
    lacks a joint, or where it is hidden from a fit). The command at time t is `signal.sample(t - onset_s)`.
    `onset_free` says that the recording does not hold its commands, so that the onset is estimated and a delay
    cannot be told from it. `start_position` (j,) rad and `start_velocity` (j,) rad/s are measured at time 0.
    `unhidden` (n, j) rad is all that was measured, where something is hidden: states that roll-outs may start from.
    `reaction` is what joints that a sub-model leaves out do to it. `turns` is the motion before time 0, where that is
    known. `start_sigma` (2, j) rad and rad/s is how well the start is known, `start_response` (s, n, j) rad what so
    much of s positions and velocities does to the readings, where that is more than nothing. `onset_sigma_s` is how
    well the onset is known, where joints that agree on it have told that, `time_sigma_s` how well the time of a sample
    is, where the readings have.
    """

    recording: Recording
    joints: tuple[str, ...]
    time_s: np.ndarray
    measured: np.ndarray
    signal: CommandSignal
    onset_s: float
    onset_free: bool
    start_position: np.ndarray
    start_velocity: np.ndarray
    unhidden: np.ndarray | None = None
    reaction: Reaction | None = None
    turns: Turns | None = None
    start_sigma: np.ndarray | None = None
    start_response: np.ndarray | None = None
    onset_sigma_s: float | None = None
    time_sigma_s: float | None = None

    @property
    def states(self) -> np.ndarray:
        """(n, j) rad: where the hand was, hidden from a fit or not."""
        return self.measured if self.unhidden is None else self.unhidden

    @property
    def moving(self) -> np.ndarray:
        """(j,) bool: the joints whose measured travel says something about a model."""
        return self.travel > MOVING_RAD

    @property
    def travel(self) -> np.ndarray:
        """(j,) rad that each joint travels, whatever single samples say."""
        return np.array([_travel(np.ascontiguousarray(column)) for column in self.measured.T])

    def with_onset(self, onset_s: float) -> Aligned:
        return replace(self, onset_s=float(onset_s))

    def controls(
        self, twin: TwinModel, time_s: np.ndarray, onset_s: float | None = None, *, mean_over_s: float = 0.0
    ) -> np.ndarray:
        """Controls (T, nu) at the given times (T,); what is never commanded holds its measured start.

        With `mean_over_s` each is the mean of the command over so much time around it.
        """
        at = time_s - (self.onset_s if onset_s is None else onset_s)
        start = np.where(np.isfinite(self.start_position), self.start_position, 0.0)
        rest = twin.drive @ start
        targets = self.signal.mean(at, mean_over_s) if mean_over_s > 0.0 else self.signal.sample(at)
        return twin.controls(self.signal.names, targets, rest)

    def start_state(self, twin: TwinModel) -> tuple[np.ndarray, np.ndarray]:
        """((nq,), (nv,)): where a roll-out starts, as true angles."""
        position = twin.measurement.invert(self.joints, self.start_position)
        qvel = np.zeros(twin.model.nv)
        qvel[twin.dof_adr] = self.start_velocity
        control = self.controls(twin, np.zeros(1))[0]
        return twin.initial_qpos(position, control), qvel


_ONSET_ROLLOUTS = 4
_ONSET_SAMPLES = 6000  # that the first look for an onset takes of a long recording
_ONSET_REACH_S = 0.2
_ONSET_FOUND_S = 2e-4


def moving_joints(recordings: Sequence[Aligned]) -> tuple[str, ...]:
    """The joints that move in any of the recordings, in their order."""
    if not recordings:
        return ()
    moving = np.any([r.moving for r in recordings], axis=0)
    return tuple(name for name, moves in zip(recordings[0].joints, moving, strict=True) if moves)


def unanswering_joints(twin: TwinModel, recordings: Sequence[Aligned]) -> tuple[str, ...]:
    """The joints that stand still in all of the recordings although their servo is told to go elsewhere, in order.

    A servo that moves any of its joints answers.
    """
    moving = np.isin(twin.joints, moving_joints(recordings))
    found = set[str]()
    for recording in recordings:
        told = recording.controls(twin, recording.time_s)
        low, high = twin.model.actuator_ctrlrange.T
        told = np.where(twin.model.actuator_ctrllimited.astype(bool), np.clip(told, low, high), told)
        for index, driven in enumerate(twin.driven):
            own = np.isin(twin.joints, driven)
            seen = own & np.isfinite(recording.measured).any(axis=0)
            if seen.any() and not (own & moving).any() and _travel(told[:, index]) > _TOLD_TIMES * MOVING_RAD:
                found |= {name for name, one in zip(twin.joints, seen, strict=True) if one}
    return tuple(name for name in twin.joints if name in found)


def judged_joints(twin: TwinModel, recordings: Sequence[Aligned]) -> tuple[str, ...]:
    """The joints that say something of a model: those that move, and those that are told to and do not, in order."""
    found = {*moving_joints(recordings), *unanswering_joints(twin, recordings)}
    return tuple(name for name in twin.joints if name in found)


def not_answering(joints: Sequence[str]) -> str:
    """What joints that are told to move and stand still may have, in words."""
    return (
        f"{', '.join(joints)}: told to move, and still all the time; a servo without torque, a torn tendon, a jammed "
        "gear and a dead sensor look alike in position: look at the joint itself"
    )


def _travel(values: np.ndarray) -> float:
    """Between the 0.5th and the 99.5th percentile of one joint's samples (n,), whatever single ones say."""
    known = np.isfinite(values)
    if known.sum() < 2:
        return 0.0
    low, high = np.percentile(values if known.all() else values[known], [0.5, 99.5])
    return float(high - low)


def _start(time_s: np.ndarray, values: np.ndarray) -> tuple[float, float, float, float]:
    """(position, velocity, their sigmas) at time 0 from a joint's samples; at rest unless the first clearly move.

    Where few samples a second show no speed that soon changes, what twice as many say otherwise counts as uncertain.
    """
    count = max(int(np.searchsorted(time_s, _SETTLE_S, side="right")), _FEWEST)
    known = np.flatnonzero(np.isfinite(values))
    early = known[known < count]
    if len(early) < _FEWEST:
        return (float(values[known[0]]) if len(known) else np.nan), 0.0, 0.0, 0.0
    at, angles = time_s[early], values[early]
    slope, offset = np.polyfit(at, angles, 1)
    scatter = float(np.std(angles - slope * at - offset))
    where = scatter / float(np.sqrt(len(at)))
    sigma = scatter / float(np.sqrt(((at - at.mean()) ** 2).sum()))
    if at[-1] > _SETTLE_S:
        longer = known[known < 2 * count]
        sigma = float(np.hypot(sigma, np.polyfit(time_s[longer], values[longer], 1)[0] - slope))
    if abs(slope) * _SETTLE_S > 6.0 * max(scatter, 2e-3):
        return float(offset), float(slope), where, sigma
    return float(np.mean(angles)), 0.0, where, max(sigma, abs(float(slope)))


def align(twin: TwinModel, recording: Recording, trajectory: Trajectory | None = None) -> Aligned:
    """Puts a recording and its commands on one clock; without recorded commands the onset is estimated.

    Times are those at which the readings were taken, where they tell that their stamps are off by chance.

    Raises BadInput where the recording shares no joint with the model, or has no commands and no trajectory.
    """
    shared = [name for name in twin.joints if name in recording.joints]
    if not shared:
        raise BadInput(
            f"none of its joints ({', '.join(recording.joints[:4])}, ...) is in the model",
            where=recording.path,
            allowed=", ".join(twin.joints[:6]) + ", ...",
            todo="Rename them with --joint-map, or choose the hand or model that was recorded",
        )
    if twin.joints == recording.joints:
        measured = recording.position
    else:
        measured = np.full((len(recording.stamp_ns), len(twin.joints)), np.nan)
        for name in shared:
            measured[:, twin.joints.index(name)] = recording.position[:, recording.joints.index(name)]
    taken = sample_times((recording.stamp_ns - recording.stamp_ns[0]) * 1e-9, measured)
    time_s = taken.time_s - taken.time_s[0]
    starts = [_start(time_s, column) for column in measured.T]
    (position, velocity), sigma = np.array(starts).T[:2], np.array(starts).T[2:]
    if trajectory is not None:
        signal = CommandSignal.from_trajectory(trajectory)
    elif recording.commands is not None:
        begins_ns = int(recording.stamp_ns[0]) + round(float(taken.time_s[0]) * 1e9)
        signal = CommandSignal.from_stream(recording.commands, begins_ns)
    else:
        raise BadInput(
            "the recording holds no commands",
            where=recording.path,
            todo="Say which trajectory ran with --trajectory FILE.yaml:NAME, or record joint_commands as well",
        )
    _require_drive(twin, signal, recording)
    found = Aligned(
        recording,
        twin.joints,
        time_s,
        measured,
        signal,
        onset_s=0.0,
        onset_free=trajectory is not None,
        start_position=position,
        start_velocity=velocity,
        start_sigma=sigma,
        time_sigma_s=taken.sigma_s,
    )
    return found.with_onset(command_onset(twin, found)) if found.onset_free else found


def _require_drive(twin: TwinModel, signal: CommandSignal, recording: Recording) -> None:
    _, determined = twin.command_map(signal.names)
    if not determined.any():
        raise BadInput(
            f"none of its commands ({', '.join(signal.names[:4])}, ...) drives the model",
            where=recording.path,
            allowed=", ".join(twin.actuators[:6]) + ", ...",
            todo="Rename them with --joint-map",
        )


def command_onset(twin: TwinModel, aligned: Aligned) -> float:
    """The shift (s) at which the raw command lies closest to the measured actuated angles.

    It contains the delay and the servo lag of the real hand: without recorded commands they cannot be told
    apart. Least squares over the actuators that move, a grid first and then a bounded refinement.
    """
    actuated = twin.drive @ aligned.measured.T  # (nu, n)
    _, determined = twin.command_map(aligned.signal.names)
    measurable = np.isfinite(actuated).sum(axis=1) > 1
    use = determined & measurable
    use[use] = np.nanmax(actuated[use], axis=1) - np.nanmin(actuated[use], axis=1) > MOVING_RAD
    if not use.any():
        return aligned.onset_s

    def error(onset: float, every: int = 1) -> float:
        commanded = aligned.controls(twin, aligned.time_s[::every], onset).T
        return float(np.nanmean((commanded[use] - actuated[use, ::every]) ** 2))

    length = float(aligned.signal.time_s[-1])
    # a repeating motion fits at several places: once found, or recorded, the onset is only refined
    near = aligned.onset_s + np.arange(-0.5, 0.5, 0.05)
    known = aligned.onset_s or not aligned.onset_free
    grid = near if known else np.arange(-length, aligned.time_s[-1], 0.05)
    every = int(np.ceil(len(aligned.time_s) / _ONSET_SAMPLES))
    best = grid[int(np.argmin([error(onset, every) for onset in grid]))]
    return lowest(error, best - 0.06, best + 0.06, 1e-4)


def model_onset(twin: TwinModel, aligned: Aligned, *, threads: int | None = None) -> float:
    """The shift (s) at which the twin's own roll-out lies closest to the measured actuated angles.

    Starts from the raw command's onset; the model brings a lag of its own, so its command has to lead. A command
    that comes later moves the whole prediction later, but for the start, so one roll-out tells the next shift.
    """
    onset = command_onset(twin, aligned)
    actuated = twin.drive @ aligned.measured.T  # (nu, n)
    use = np.any(twin.drive[:, aligned.moving] != 0, axis=1) & np.isfinite(actuated).any(axis=1)
    if not use.any():
        return onset
    measured = actuated[use]
    best = (np.inf, onset)
    for _ in range(_ONSET_ROLLOUTS):
        predicted = twin.drive[use] @ predict(twin, aligned.with_onset(onset), threads=threads).T
        if not np.isfinite(predicted).all():
            break

        def error(shift: float, predicted: np.ndarray = predicted) -> float:
            moved = [np.interp(aligned.time_s - shift, aligned.time_s, row) for row in predicted]
            return float(np.nanmean((np.array(moved) - measured) ** 2))

        best = min(best, (error(0.0), onset))
        grid = np.linspace(-_ONSET_REACH_S, _ONSET_REACH_S, 41)
        near = float(grid[int(np.argmin([error(shift) for shift in grid]))])
        shift = lowest(error, near - 0.01, near + 0.01, 1e-5)
        if abs(shift) < _ONSET_FOUND_S:
            break
        onset += shift
    return best[1]


def predict(twin: TwinModel, aligned: Aligned, *, threads: int | None = None) -> np.ndarray:
    """What the sensors would read had the twin been the hand: (n, j) rad."""
    step_s = float(twin.model.opt.timestep)
    steps = int(np.ceil(aligned.time_s[-1] / step_s)) + 1
    grid = np.arange(steps) * step_s
    controls = aligned.controls(twin, grid)
    qpos, qvel = aligned.start_state(twin)
    applied = None if aligned.reaction is None else aligned.reaction.applied(twin, grid, twin.measurement)[None]
    positions = roll_out([twin.model], controls[None], qpos[None], qvel[None], applied=applied, threads=threads)
    sampled = resample(positions[:, :, twin.qpos_adr], step_s, aligned.time_s)
    return twin.measurement.apply(twin.joints, sampled)[0]


def resample(positions: np.ndarray, step_s: float, time_s: np.ndarray) -> np.ndarray:
    """Positions (B, T, j) on a grid from 0 -> linear interpolation at times (n,): (B, n, j)."""
    place = np.clip(time_s / step_s, 0.0, positions.shape[1] - 1)
    index = np.minimum(place.astype(int), positions.shape[1] - 2)
    weight = (place - index)[None, :, None]
    return positions[:, index] * (1.0 - weight) + positions[:, index + 1] * weight
