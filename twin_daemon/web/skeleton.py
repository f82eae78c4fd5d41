"""The hand in space as lines: between the origins of its bodies, and on to its fingertips."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Bone:
    """A line between two points. `joints` are the columns of those that turn it against what lies before."""

    start: int
    end: int
    joints: tuple[int, ...]


class Skeleton:
    """Points of the hand at given joint angles. For one thread at a time."""

    def __init__(self, twin: TwinModel) -> None:
        self._twin = twin
        self._data = mujoco.MjData(twin.model)
        model = twin.model
        columns = {int(address): column for column, address in enumerate(twin.qpos_adr)}
        moving: list[tuple[int, ...]] = []
        for body in range(model.nbody):
            first = int(model.body_jntadr[body])
            addresses = [int(model.jnt_qposadr[first + k]) for k in range(int(model.body_jntnum[body]))]
            moving.append(tuple(columns[a] for a in addresses if a in columns))
        parents = [int(parent) for parent in model.body_parentid]
        leaves = [body for body in range(1, model.nbody) if body not in parents[1:]]
        self._leaves = np.array(leaves, int)
        self._tips = np.array([_far_end(model, body) for body in leaves]).reshape(-1, 3)  # in the body's frame
        inner = [(parents[body], body) for body in range(1, model.nbody) if model.body_pos[body].any()]
        outer = [(body, model.nbody + number) for number, body in enumerate(leaves)]
        bones = [Bone(start, end, _turned_by(model, start, moving)) for start, end in inner + outer]
        self.bones = tuple(bone for bone in bones if bone.joints)  # what no joint turns is no part of the hand's motion

    def points(self, reading_rad: np.ndarray) -> np.ndarray:
        """(p, 3) m for readings (j,) rad; joints that are not known (NaN) stand at the model's zero."""
        model, data = self._twin.model, self._data
        data.qpos[:] = self._twin.initial_qpos(self._twin.measurement.invert(self._twin.joints, reading_rad))
        mujoco.mj_kinematics(model, data)
        turned = data.xmat[self._leaves].reshape(-1, 3, 3)
        tips = data.xpos[self._leaves] + np.einsum("kab,kb->ka", turned, self._tips)
        return np.concatenate([data.xpos, tips])


def _turned_by(model: mujoco.MjModel, body: int, moving: list[tuple[int, ...]]) -> tuple[int, ...]:
    """The joints of the nearest body, from this one towards the root, that has any; of several at one place all."""
    joints: tuple[int, ...] = ()
    while body:
        joints = moving[body] + joints
        if joints and model.body_pos[body].any():
            break
        body = int(model.body_parentid[body])
    return joints


def _far_end(model: mujoco.MjModel, body: int) -> np.ndarray:
    """(3,) m in the body's frame: beyond the middle of its farthest geometry, by as much as that reaches."""
    geoms = np.flatnonzero(model.geom_bodyid == body)
    if not len(geoms):
        return np.zeros(3)
    middles = model.geom_pos[geoms]
    distances = np.linalg.norm(middles, axis=1)
    farthest = int(np.argmax(distances))
    if distances[farthest] == 0.0:
        return np.zeros(3)
    return middles[farthest] * (1.0 + min(float(model.geom_rbound[geoms[farthest]]), 0.02) / distances[farthest])
