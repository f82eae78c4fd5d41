"""What links that are heavier, longer or stouter than their model do to the joints that carry them, as torques.

Masses, centres of mass and inertias of a model are a few per cent off. Torques are linear in them (Featherstone 2008,
chapter 10), so that along a measured motion each gives a torque signal at each joint that carries its link.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.simulation.prescribed import Motion
from twin_daemon.simulation.submodel import upwards
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class _Load:
    """What is more of a link, (m, 3) each in the world: a force `pull`, a `shift` of its centre, a torque `turn`."""

    pull: np.ndarray
    shift: np.ndarray
    turn: np.ndarray


@dataclass(frozen=True)
class LinkPaths:
    """How all links of a robot move along one recording, in the world: b bodies, v joints, m times.

    `centre` (m, b, 3) with its `force` (m, b, 3) for moving and carrying the mass there, `frame` (m, b, 3, 3) the axes
    of inertia, `spin` (m, b, 3) the change of angular momentum, `axis` and `anchor` (m, v, 3) of the joints.
    """

    twin: TwinModel
    time_s: np.ndarray
    centre: np.ndarray
    force: np.ndarray
    frame: np.ndarray
    spin: np.ndarray
    axis: np.ndarray
    anchor: np.ndarray

    @classmethod
    def along(cls, twin: TwinModel, motion: Motion) -> LinkPaths:
        """Of all links of a whole robot along its measured motion."""
        model, data = twin.model, mujoco.MjData(twin.model)
        count, bodies = len(motion.time_s), model.nbody
        centre, frame = np.empty((count, bodies, 3)), np.empty((count, bodies, 9))
        turning = np.empty((count, bodies, 3))
        axis, anchor = np.empty((count, model.njnt, 3)), np.empty((count, model.njnt, 3))
        for row in range(count):
            data.qpos[twin.qpos_adr] = motion.position[row]
            data.qvel[twin.dof_adr] = motion.velocity[row]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            centre[row], frame[row], turning[row] = data.xipos, data.ximat, data.cvel[:, :3]
            axis[row], anchor[row] = data.xaxis, data.xanchor
        step_s = float(motion.time_s[1] - motion.time_s[0])
        frames = frame.reshape(count, bodies, 3, 3)
        own = np.einsum("mbji,mbj->mbi", frames, turning) * model.body_inertia
        momentum = np.einsum("mbij,mbj->mbi", frames, own)
        weight = _twice(centre, step_s) - model.opt.gravity
        force, spin = model.body_mass[:, None] * weight, np.gradient(momentum, step_s, axis=0)
        return cls(twin, motion.time_s, centre, force, frames, spin, axis, anchor)

    def torques(self, joints: Sequence[str], share: float) -> np.ndarray:
        """(m, k, p) N m of k joints: for each link that they carry its mass, centre (three ways) and inertia, by sigma.

        All are uncertain by a `share` of themselves, a centre by that share of its distance from the link's joint.
        """
        twin, model = self.twin, self.twin.model
        dofs = [int(twin.dof_adr[twin.joints.index(joint)]) for joint in joints]
        carries = np.array([[int(model.dof_bodyid[d]) in upwards(model, b) for b in range(model.nbody)] for d in dofs])
        found = []
        for body in np.flatnonzero(carries.any(axis=0)).tolist():
            if model.body_mass[body] <= 0.0:
                continue
            for load in self._loads(body):
                column = np.zeros((len(self.time_s), len(dofs)))
                for index in np.flatnonzero(carries[:, body]):
                    column[:, index] = self._felt(int(model.dof_jntid[dofs[index]]), body, load)
                found.append(share * column)
        return np.stack(found, axis=2) if found else np.zeros((len(self.time_s), len(dofs), 0))

    def _loads(self, body: int) -> list[_Load]:
        """What a link's mass, its centre (three ways) and its inertia are to the joints that carry it."""
        model, step_s = self.twin.model, float(self.time_s[1] - self.time_s[0])
        none = np.zeros_like(self.force[:, body])
        loads = [_Load(self.force[:, body], none, none)]
        distance, mass = float(np.linalg.norm(model.body_ipos[body])), float(model.body_mass[body])
        for way in range(3):
            shift = distance * self.frame[:, body, :, way]
            loads.append(_Load(mass * _twice(shift, step_s), shift, none))
        return [*loads, _Load(none, none, self.spin[:, body])]

    def _felt(self, joint: int, body: int, load: _Load) -> np.ndarray:
        """(m,) N m (N of a slide) of a joint that carries a link with a load at its centre."""
        axis = self.axis[:, joint]
        if self.twin.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            return (axis * load.pull).sum(axis=1)
        arm = self.centre[:, body] - self.anchor[:, joint]
        moment = np.cross(arm, load.pull) + np.cross(load.shift, self.force[:, body]) + load.turn
        return (axis * moment).sum(axis=1)


def _twice(values: np.ndarray, step_s: float) -> np.ndarray:
    """The second derivative of (m, ...) by time."""
    return np.gradient(np.gradient(values, step_s, axis=0), step_s, axis=0)
