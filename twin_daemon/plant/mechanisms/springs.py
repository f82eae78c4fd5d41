"""What stores energy at a joint: springs, a strand with memory, a soft stop, and the bias that splits a finger."""

from __future__ import annotations

import mujoco
import numpy as np

from ..rig import REFERENCE_STEP_S
from .base import AtPorts, Mechanism, State


class Spring(AtPorts):
    """Linear spring about `ref` rad."""

    def update(self) -> None:
        self._stiffness = self.ordered(self.value)
        self._ref = self.ordered(self.more["ref"])

    def joint(self, state: State) -> None:
        self.ports.add(state, -self._stiffness * (self.ports.angle(state) - self._ref))


class CubicSpring(Spring):
    """Hardening spring: torque grows with the cube of the angle from `ref`."""

    def joint(self, state: State) -> None:
        self.ports.add(state, -self._stiffness * (self.ports.angle(state) - self._ref) ** 3)


class SoftStop(AtPorts):
    """A one-sided damped spring that begins `value` rad before the upper end of the range."""

    def update(self) -> None:
        self._start = self.ports.high - self.ordered(self.value)
        most = 0.25 * self.ports.inertia / REFERENCE_STEP_S**2
        stiffness = self.ordered(self.more["stiffness"])
        self._stiffness = np.where(self.ordered(self.value) > 0.0, np.minimum(stiffness, most), 0.0)
        self._damping = 0.5 * np.sqrt(self._stiffness * self.ports.inertia)

    def joint(self, state: State) -> None:
        depth = self.ports.angle(state) - self._start
        push = self._stiffness * depth + self._damping * self.ports.speed(state)
        # rubber pushes, it never pulls back
        self.ports.add(state, -np.where(depth > 0.0, np.maximum(push, 0.0), 0.0))


class Hysteresis(AtPorts):
    """Bouc-Wen strand beside the joint: stiff after a reversal, yielding at `value` N m.

    Wen, J. Eng. Mech. 102 (1976), with exponent 2 and beta = gamma = 1/2: the strand unloads along its first slope.
    """

    def update(self) -> None:
        self._yield = self.ordered(self.value)
        self._angle = self.ordered(self.more["yield_angle"])

    def prepare(self) -> None:
        super().prepare()
        self._strain = np.zeros(len(self.names))  # 1 where fully yielded

    def reset(self) -> None:
        self._strain[:] = 0.0

    def joint(self, state: State) -> None:
        pace = self.ports.speed(state) / self._angle
        loading = pace * self._strain > 0.0
        self._strain += state.step_s * pace * np.where(loading, 1.0 - self._strain**2, 1.0)
        np.clip(self._strain, -1.0, 1.0, out=self._strain)
        self.ports.add(state, -self._yield * self._strain)


class Coupling(Mechanism):
    """One motor, two joints: a preload holds J1 open and springs pull on both, so J2 closes first and J1 last.

    The tendon sets only the sum of both angles; how it splits is decided by these torques. `value` is the preload on
    J1; springs are in parts of it per rad.
    """

    stages = ("joint",)

    def prepare(self) -> None:
        rig, distal, proximal = self.rig, [], []
        for name in self.names:
            joints = [rig.joint_index[joint] for joint in rig.hand.description.commands[name].joints]
            joints.sort(key=lambda row: _depth(rig.model, int(rig.body_of[row])))
            proximal.append(joints[0])
            distal.append(joints[-1])
        self._q1, self._dof1 = rig.qpos_of[distal], rig.dof_of[distal]
        self._q2, self._dof2 = rig.qpos_of[proximal], rig.dof_of[proximal]

    def joint(self, state: State) -> None:
        k1, k2 = self.more["spring_j1"], self.more["spring_j2"]
        state.joint_torque[self._dof1] -= self.value * (1.0 + k1 * state.qpos[self._q1])
        state.joint_torque[self._dof2] -= self.value * k2 * state.qpos[self._q2]


def _depth(model: mujoco.MjModel, body: int) -> int:
    depth = 0
    while body:
        body, depth = int(model.body_parentid[body]), depth + 1
    return depth
