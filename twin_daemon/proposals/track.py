"""What was measured along a recording, on the steps of a roll-out: what a law may depend on beside a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from scipy.signal import savgol_filter

from twin_daemon.estimation.partition import restricted
from twin_daemon.proposals.thresholds import HEATING_S, LEAST_ACROSS, OWN_ANGLE_RAD, SMOOTHED_S
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Track:
    """One recording at times `time_s` (m,), each of the others (m,) too.

    The joint's angle, velocity and acceleration, the servo's target, error and heat, how the link lies to gravity
    (`orientation`), and the neighbours' angles.
    `onset_s` is the recording's own, by which pieces of it know their place.
    """

    sha256: str
    onset_s: float
    time_s: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    command: np.ndarray
    error: np.ndarray
    heat: np.ndarray
    orientation: np.ndarray
    neighbours: dict[str, np.ndarray]

    VARIABLES: ClassVar = ("time", "position", "velocity", "acceleration", "command", "error", "heat", "orientation")

    def of(self, variable: str) -> np.ndarray:
        """(m,) one of the joint's own variables."""
        return self.time_s if variable == "time" else getattr(self, variable)

    def of_neighbour(self, name: str, over: str) -> np.ndarray:
        """(m,) the angle of a neighbour, or its velocity."""
        angle = self.neighbours[name]
        return np.gradient(angle, self.time_s) if over == "neighbour_velocity" else angle

    def begin_s(self, piece: Aligned) -> float:
        """When a piece of this recording begins."""
        return self.onset_s - piece.onset_s


def track(
    small: TwinModel, robot: TwinModel, whole: Aligned, joint: str, actuator: int, neighbours: Sequence[str]
) -> Track:
    """The measured motion of one recording as a law at `joint` of a `small` part of a robot and its servo see it."""
    step_s = float(small.model.opt.timestep)
    grid = np.arange(int(np.ceil(whole.time_s[-1] / step_s)) + 1) * step_s
    cut = restricted(whole, small)
    period = float(np.median(np.diff(whole.time_s)))

    def smooth(name: str) -> np.ndarray:
        column = whole.states[:, whole.joints.index(name)]
        known = np.isfinite(column)
        if not known.any():
            return np.zeros_like(grid)
        window = 2 * int(0.5 * SMOOTHED_S / period) + 1
        values = column[known]
        if 5 <= window < len(values):
            values = np.asarray(savgol_filter(values, window, 2), float)
        return np.interp(grid, whole.time_s[known], values)

    own = {name: smooth(name) for name in small.joints}
    position = own[joint]
    actuated = sum(c * own[name] for c, name in zip(small.drive[actuator], small.joints, strict=True))
    command = cut.controls(small, grid)[:, actuator]
    error = command - actuated
    power = error**2 / max(float(np.mean(error**2)), 1e-12)
    heat = np.empty_like(power)
    warm, keep = 0.0, np.exp(-step_s / HEATING_S)
    for index, now in enumerate(power):
        warm = keep * warm + (1.0 - keep) * now
        heat[index] = warm
    velocity = np.gradient(position, step_s)
    read = np.interp(whole.time_s, grid, position)  # between samples it is straight, and has no second derivative
    acceleration = np.interp(grid, whole.time_s, np.gradient(np.gradient(read, whole.time_s), whole.time_s))
    angles = np.stack([np.interp(whole.time_s, grid, smooth(name)) for name in robot.joints], axis=1)
    lies = np.interp(grid, whole.time_s, orientation(robot, angles, joint))
    found = {name: smooth(name) for name in neighbours}
    sha = whole.recording.sha256
    return Track(sha, whole.onset_s, grid, position, velocity, acceleration, command, error, heat, lies, found)


def orientation(robot: TwinModel, angles: np.ndarray, joint: str) -> np.ndarray:
    """(n,) rad: the angle of gravity about a hinge's axis in the frame of the link that it turns.

    `angles` (n, j) rad are those of the robot's joints.

    Zeros for a slide, for an axis along which gravity pulls, and where the joint alone turns the link: then its own
    angle says as much.
    """
    model, none = robot.model, np.zeros(len(angles))
    joint_id = model.joint(joint).id
    if model.jnt_type[joint_id] != mujoco.mjtJoint.mjJNT_HINGE:
        return none
    body, data = int(model.jnt_bodyid[joint_id]), mujoco.MjData(model)
    axis = model.jnt_axis[joint_id]
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    across = np.stack([first, np.cross(axis, first)])
    pulls = np.empty((len(angles), 2))
    for index, at in enumerate(angles):
        data.qpos[robot.qpos_adr] = at
        mujoco.mj_kinematics(model, data)
        pulls[index] = across @ data.xmat[body].reshape(3, 3).T @ model.opt.gravity
    if np.hypot(*pulls.T).min() <= LEAST_ACROSS * np.linalg.norm(model.opt.gravity):
        return none
    found = np.unwrap(np.arctan2(pulls[:, 1], pulls[:, 0]))
    own = angles[:, robot.joints.index(joint)]
    apart = min(float(np.std(found - own)), float(np.std(found + own)))
    return found if apart > OWN_ANGLE_RAD else none
