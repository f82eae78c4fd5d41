"""Between motor and joint: a gap, a spring, a tendon that creeps, and one that slips."""

from __future__ import annotations

import numpy as np

from ..rig import REFERENCE_STEP_S
from .base import Mechanism, State

_CROSSING_S = 0.001
_MOTOR_SHARE = 0.5


class _BesideServos(Mechanism):
    def prepare(self) -> None:
        self.rows = self.command_rows()


class Backlash(_BesideServos):
    """A free gap of `value` rad. The servo holds the motor; the joint feels it only where a flank touches.

    Within the gap the motor is light and runs to its target with a time constant of 10 ms; at a flank it moves with
    the joint. So the torque at rest is that of the servo on the joint's angle with a dead zone of the gap's width
    (Nordin and Gutman, Automatica 38, 2002: dead-zone model with massless play).
    """

    stages = ("transmission", "output")

    def reset(self) -> None:
        self._motor: np.ndarray | None = None

    def transmission(self, state: State) -> None:
        rows, half = self.rows, 0.5 * self.value
        joint = state.servo_angle[rows]
        if self._motor is None:
            self._motor = joint.copy()
        goal = -(self.rig.gain[rows] * state.target[rows] + self.rig.bias[rows]) / self.rig.pull[rows]
        free = goal + np.exp(-state.step_s / _CROSSING_S) * (self._motor - goal)
        self._motor = np.clip(free, joint - half, joint + half)
        state.servo_angle[rows] = self._motor
        self._ahead = self._motor - joint

    def output(self, state: State) -> None:
        rows, edge = self.rows, 0.5 * self.value - 1e-12
        torque = state.torque[rows]
        pushes = ((torque > 0.0) & (self._ahead >= edge)) | ((torque < 0.0) & (self._ahead <= -edge))
        state.torque[rows] = np.where(pushes, torque, 0.0)


class Elasticity(_BesideServos):
    """A spring of compliance `value` rad/(N m) between the motor, which the servo holds, and the joint.

    Half of the damping and rotor inertia of the nominal joint belongs to the motor's side of the spring, so that a
    stiff spring gives the nominal joint back. A spring stiffer than the step can carry is taken as rigid.
    """

    stages = ("transmission", "output")

    def prepare(self) -> None:
        super().prepare()
        model, rig = self.rig.model, self.rig
        self._soft = np.zeros(len(self.rows), dtype=bool)
        self._damping = np.array([_MOTOR_SHARE * rig.lumped(model.dof_damping, row) for row in self.rows])
        rotor = np.array([_MOTOR_SHARE * rig.lumped(model.dof_armature, row) for row in self.rows])
        inertia = np.array([rig.inertia_at(name) for name in self.names])
        self._rotor = np.maximum(rotor, 0.05 * inertia)
        self._most = 0.25 * inertia / REFERENCE_STEP_S**2

    def update(self) -> None:
        with np.errstate(divide="ignore"):
            self._stiffness = np.minimum(1.0 / self.value, self._most)
        self._strand_damping = 0.1 * np.sqrt(self._stiffness * self._rotor)
        newly = (self.value > 0.0) & ~self._soft
        for row in self.rows[newly]:
            dofs = np.flatnonzero(self.rig.arms[row])
            self.rig.model.dof_damping[dofs] *= 1.0 - _MOTOR_SHARE
            self.rig.model.dof_armature[dofs] *= 1.0 - _MOTOR_SHARE
        if newly.any():
            self._soft |= newly
            self.rig.refresh()

    def reset(self) -> None:
        self._motor: np.ndarray | None = None
        self._speed = np.zeros(len(self.rows))

    def transmission(self, state: State) -> None:
        rows = self.rows
        if self._motor is None:
            self._motor = state.servo_angle[rows].copy()
            self._speed = state.servo_speed[rows].copy()
        # what the tendon has crept or slipped lies between motor and joint too
        self._slack = state.servo_angle[rows] - state.angle[rows]
        state.servo_angle[rows] = np.where(self._soft, self._motor, state.servo_angle[rows])
        state.servo_speed[rows] = np.where(self._soft, self._speed, state.servo_speed[rows])

    def output(self, state: State) -> None:
        rows, step = self.rows, state.step_s
        assert self._motor is not None  # set by the transmission stage of this step
        twist = self._motor - state.angle[rows] - self._slack
        strand = self._stiffness * twist + self._strand_damping * (self._speed - state.speed[rows])
        resist = self._rotor + step * (self._damping + self._strand_damping) + step**2 * self._stiffness
        push = state.torque[rows] - strand - self._damping * self._speed
        self._speed = self._speed + step * push / resist
        self._motor = self._motor + step * self._speed
        state.torque[rows] = np.where(self._soft, strand, state.torque[rows])


class Creep(_BesideServos):
    """Polymer tendon: under load it lengthens slowly and recovers slowly (Kelvin-Voigt), so the joint's zero drifts."""

    stages = ("transmission", "output")

    def reset(self) -> None:
        self._stretch = np.zeros(len(self.rows))

    def transmission(self, state: State) -> None:
        state.servo_angle[self.rows] += self._stretch

    def output(self, state: State) -> None:
        toward = self.value * state.torque[self.rows] - self._stretch
        self._stretch = self._stretch + toward * (state.step_s / self.more["time"])


class Slip(_BesideServos):
    """At more than `threshold` N m the tendon jumps on its pulley by `value` rad, at most once in `pause` s."""

    stages = ("transmission", "output")

    def reset(self) -> None:
        self._jumped = np.zeros(len(self.rows))
        self._last = np.full(len(self.rows), -np.inf)

    def transmission(self, state: State) -> None:
        state.servo_angle[self.rows] += self._jumped

    def output(self, state: State) -> None:
        torque = state.torque[self.rows]
        jumps = (np.abs(torque) > self.more["threshold"]) & (state.time_s - self._last >= self.more["pause"])
        if jumps.any():
            self._jumped = self._jumped + np.where(jumps, np.sign(torque) * self.value, 0.0)
            self._last = np.where(jumps, state.time_s, self._last)
