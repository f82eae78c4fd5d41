"""The torque of a law within roll-outs, and what it remembers of the motion before them."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from scipy.signal import lfilter

from twin_daemon.proposals.features import Feature
from twin_daemon.proposals.thresholds import SETTLING_S, STRONGEST_RAD
from twin_daemon.proposals.track import Track
from twin_daemon.simulation.feedback import Torque
from twin_daemon.simulation.twin import TwinModel


class LawFeedback:
    """The torque of a law in roll-outs, from the state of all simulations at once."""

    def __init__(
        self,
        twin: TwinModel,
        feature: Feature,
        joint: str,
        actuator: int,
        models: Sequence[mujoco.MjModel],
        *,
        laws: np.ndarray,
        memory: np.ndarray,
        piece_of: np.ndarray,
        exogenous: np.ndarray,
    ) -> None:
        """Of S simulations of `models`, with coefficients `laws` (S, k) at an actuator of a joint.

        `memory` (S, m) is what each remembers where it begins, and `exogenous` (r, n) what a law depends on beside the
        joint's own state at each of n steps of each of r pieces, of which a simulation is of `piece_of` (S,).
        """
        self._feature, self._laws, self._state = feature, laws, memory.copy()
        self._piece_of, self._exogenous = piece_of, exogenous
        self._step_s = float(twin.model.opt.timestep)
        column = twin.joints.index(joint)
        self._qpos, self._dof = twin.qpos_adr[column], twin.dof_adr[column]
        self._actuator = actuator
        self._qpos_driven, self._dof_driven = twin.qpos_adr, twin.dof_adr
        self._drive = twin.drive[actuator]
        self._kp = np.array([model.actuator_gainprm[actuator, 0] for model in models])
        self._friction = [model.dof_frictionloss for model in models]
        self._own_friction = np.array([friction[self._dof] for friction in self._friction])
        self._last: np.ndarray | None = None
        self._lengths = np.array(self._feature.knots)
        if self._feature.memory:
            self._keep = np.exp(-self._step_s / self._lengths)
        self._settles = 1.0 - float(np.exp(-self._step_s / SETTLING_S))
        self.level: np.ndarray | None = None

    def torque(self, step: int, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray) -> np.ndarray:
        """(a, nv) N m of the simulations that still run."""
        active, feature = len(qpos), self._feature
        angle = qpos[:, self._qpos]
        error = ctrl[:, self._actuator] - qpos[:, self._qpos_driven] @ self._drive
        self._remember(active, angle, error, qvel[:, self._dof], ctrl[:, self._actuator])
        laws = self._laws[:active]
        if feature.memory in ("lag", "slew"):
            value = (laws * (self._state[:active] - ctrl[:, [self._actuator]])).sum(axis=1)
        elif feature.memory:
            value = (laws * self._state[:active]).sum(axis=1)
        else:
            value = feature.curve(laws, self._over(step, active, angle, qvel, error, ctrl))
        if feature.factor == "error":
            value = value * error
        elif feature.factor == "velocity":
            value = value * qvel[:, self._dof]
        elif feature.factor == "direction":
            value = self._rub(value, qvel[:, self._dof])
        if feature.memory in ("play", "relaxation", "creep"):
            value = -value
        out = np.zeros_like(qvel)
        kp = self._kp[:active]
        if feature.port == "command":
            pull = np.clip(value, -STRONGEST_RAD, STRONGEST_RAD) * kp
            out[:, self._dof_driven] = pull[:, None] * self._drive
        else:
            out[:, self._dof] = np.clip(value, -STRONGEST_RAD * kp, STRONGEST_RAD * kp)
        return out

    def _rub(self, level: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """(a,) N m of dry friction beside what the solver holds by, with `level` (a,) set to more or less than its own.

        A friction between -forwards and +backwards is one of their mean either way, with half their difference as a
        constant torque. Only the solver's own friction lets a joint stick.
        """
        active = len(level)
        beside = np.zeros(active)
        if self._feature.over == "velocity":
            least = min(knot for knot in self._feature.knots if knot > 0.0)
            fast = np.maximum(np.abs(speed), least)
            laws = self._laws[:active]
            forwards, backwards = self._feature.curve(laws, fast), self._feature.curve(laws, -fast)
            level, beside = 0.5 * (forwards + backwards), 0.5 * (backwards - forwards)
        self.level = level
        return beside

    def hold(self, level: np.ndarray) -> None:
        """Lets the solver hold each joint by its own friction and levels (a,) N m beside it."""
        bounds = np.maximum(self._own_friction[: len(level)] + level, 0.0)
        for friction, bound in zip(self._friction, bounds.tolist(), strict=False):
            friction[self._dof] = bound

    def _over(
        self, step: int, active: int, angle: np.ndarray, qvel: np.ndarray, error: np.ndarray, ctrl: np.ndarray
    ) -> np.ndarray:
        over = self._feature.over
        if over == "position":
            return angle
        if over == "velocity":
            return qvel[:, self._dof]
        if over == "acceleration":
            return self._state[:active, 0]
        if over == "load":
            return self._kp[:active] * np.abs(error)
        if over == "error":
            return error
        if over == "command":
            return ctrl[:, self._actuator]
        return self._exogenous[self._piece_of[:active], step]

    def _remember(
        self, active: int, angle: np.ndarray, error: np.ndarray, speed: np.ndarray, command: np.ndarray
    ) -> None:
        feature, state = self._feature, self._state
        if feature.over == "acceleration":
            rate = np.zeros(active) if self._last is None else (speed - self._last[:active]) / self._step_s
            self._last = speed.copy()
            state[:active, 0] += self._settles * (rate - state[:active, 0])
            return
        moved = np.zeros(active) if self._last is None else angle - self._last[:active]
        self._last = angle.copy()
        if feature.memory == "play":
            state[:active] = np.clip(state[:active] + moved[:, None] / self._lengths, -1.0, 1.0)
        elif feature.memory == "relaxation":
            state[:active] = self._keep * state[:active] + moved[:, None]
        elif feature.memory == "slew":
            most = self._lengths * self._step_s
            state[:active] += np.clip(command[:, None] - state[:active], -most, most)
        elif feature.memory in ("creep", "lag"):
            follows = (error if feature.memory == "creep" else command)[:, None]
            state[:active] = self._keep * state[:active] + (1.0 - self._keep) * follows


def feedback_of_all(laws: Sequence[LawFeedback]) -> Torque:
    """The torque of all laws at a joint together; what they say of its dry friction adds up."""

    def torque(step: int, qpos: np.ndarray, qvel: np.ndarray, ctrl: np.ndarray) -> np.ndarray:
        total = sum((law.torque(step, qpos, qvel, ctrl) for law in laws), start=np.zeros_like(qvel))
        levels = [law.level for law in laws if law.level is not None]
        if levels:
            laws[0].hold(np.sum(levels, axis=0))
        return total

    return torque


def remembered(feature: Feature, track: Track, before: np.ndarray, step_s: float) -> np.ndarray:
    """(m,) the state of a law's memory after the part `before` (n,) of a track: each element's."""
    if not feature.memory:
        return track.acceleration[before][-1:] if feature.over == "acceleration" else np.zeros(0)
    if feature.memory == "play":
        widths = np.array(feature.knots)
        state = np.zeros(len(widths))
        for moved in np.diff(track.position[before]):
            state = np.clip(state + moved / widths, -1.0, 1.0)
        return state
    if feature.memory == "slew":
        state, most = np.full(len(feature.knots), track.command[0]), np.array(feature.knots) * step_s
        for now in track.command[before]:
            state += np.clip(now - state, -most, most)
        return state
    keep = np.exp(-step_s / np.array(feature.knots))
    if feature.memory == "relaxation":
        # each movement enters whole
        return _filtered(np.diff(track.position[before], prepend=track.position[0]), keep, np.ones_like(keep), 0.0)
    if feature.memory == "lag":
        return _filtered(track.command[before], keep, 1.0 - keep, float(track.command[0]))
    return _filtered(track.error[before], keep, 1.0 - keep, 0.0)


def _filtered(series: np.ndarray, keep: np.ndarray, enters: np.ndarray, start: float) -> np.ndarray:
    """(m,) the last of state = keep state + enters x over a series (n,), from `start`."""
    last = [lfilter([e], [1.0, -k], series, zi=[k * start])[0][-1] for k, e in zip(keep, enters, strict=True)]
    return np.array(last)
