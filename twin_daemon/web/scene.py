"""The hand in space: its geometry once, and where its bodies are at given readings."""

from __future__ import annotations

import base64
from functools import cached_property
from typing import Any

import mujoco
import numpy as np

from twin_daemon.simulation.submodel import upwards
from twin_daemon.simulation.twin import TwinModel

_SHAPES = {
    mujoco.mjtGeom.mjGEOM_SPHERE: "sphere",
    mujoco.mjtGeom.mjGEOM_CAPSULE: "capsule",
    mujoco.mjtGeom.mjGEOM_ELLIPSOID: "ellipsoid",
    mujoco.mjtGeom.mjGEOM_CYLINDER: "cylinder",
    mujoco.mjtGeom.mjGEOM_BOX: "box",
    mujoco.mjtGeom.mjGEOM_MESH: "mesh",
}


class Scene:
    """The bodies of a twin at given joint angles. For one thread at a time."""

    def __init__(self, twin: TwinModel) -> None:
        self._twin = twin
        self._data = mujoco.MjData(twin.model)
        model = twin.model
        columns = {int(address): column for column, address in enumerate(twin.qpos_adr)}
        self.joints: list[list[int]] = []
        for body in range(model.nbody):
            first = int(model.body_jntadr[body])
            own = [int(model.jnt_qposadr[first + k]) for k in range(int(model.body_jntnum[body]))]
            turned = [columns[address] for address in own if address in columns]
            # what is fixed to a link is coloured as that link
            self.joints.append(turned or (self.joints[int(model.body_parentid[body])] if body else []))

    def described(self) -> dict[str, Any]:
        """The geoms in their bodies' frames, and by body the columns of the joints that turn it; m, rad, row by row.

        `size` is as in MJCF: radius and half length of a capsule, half sizes of a box. Meshes are float32 points and
        uint32 triangles in base64. Geoms of the floor, and those that are not to be seen, are left out.
        """
        model, meshes = self._twin.model, {}
        geoms = []
        for number in range(model.ngeom):
            shape = _SHAPES.get(mujoco.mjtGeom(int(model.geom_type[number])))
            colour = _colour(model, number)
            if shape is None or colour[3] == 0.0:
                continue
            geom: dict[str, Any] = {
                "body": int(model.geom_bodyid[number]),
                "shape": shape,
                "size": model.geom_size[number].tolist(),
                "position": model.geom_pos[number].tolist(),
                "quaternion": model.geom_quat[number].tolist(),
                "rgba": colour,
            }
            if shape == "mesh":
                mesh = geom["mesh"] = int(model.geom_dataid[number])
                meshes.setdefault(mesh, _mesh(model, mesh))
            geoms.append(geom)
        return {
            "bodies": model.nbody,
            "joints": self.joints,
            "geoms": geoms,
            "meshes": meshes,
            "tendons": self._tendons(),
            "tips": {name: [body, *point] for name, (body, point) in self.tips.items()},
        }

    @cached_property
    def tips(self) -> dict[str, tuple[int, list[float]]]:
        """By joint the tip of what it moves: the last body of its longest chain, and there the geom farthest from the
        joint, as a point (m) in that body's frame."""
        model, found = self._twin.model, {}
        far = np.zeros(model.nbody)  # m along the chain from the base
        for body in range(1, model.nbody):
            far[body] = far[int(model.body_parentid[body])] + np.linalg.norm(model.body_pos[body])
        for name, dof in zip(self._twin.joints, self._twin.dof_adr, strict=True):
            own = int(model.dof_bodyid[dof])
            carried = [body for body in range(own, model.nbody) if own in upwards(model, body)]
            moved = [body for body in carried if model.body_dofnum[body]] or [own]
            body = max(moved, key=lambda one: far[one])
            first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
            places = model.geom_pos[first : first + count] if count else np.zeros((1, 3))
            found[name] = body, places[int(np.argmax(np.linalg.norm(places, axis=1)))].tolist()
        return found

    def tip(self, joint: str, poses: np.ndarray) -> np.ndarray:
        """(3,) m: the tip of what a joint moves, at `poses` (b, 7)."""
        body, point = self.tips[joint]
        turned = np.empty(3)
        mujoco.mju_rotVecQuat(turned, np.array(point), poses[body, 3:])
        return poses[body, :3] + turned

    def contacts(self, reading_rad: np.ndarray) -> np.ndarray:
        """(k, 4) m: where geoms touch or are closer than their margin at readings (j,) rad, and how far apart they are
        (negative where they overlap)."""
        self.poses(reading_rad)
        mujoco.mj_comPos(self._twin.model, self._data)
        mujoco.mj_collision(self._twin.model, self._data)
        return np.column_stack([self._data.contact.pos, self._data.contact.dist])

    def _tendons(self) -> list[dict[str, Any]]:
        """Each tendon as points (body, x, y, z): sites in the bodies' frames (m), or for one that couples joints, their
        axes. Where it wraps around a geom the straight way is shown."""
        model, found = self._twin.model, []
        for tendon in range(model.ntendon):
            first, points = int(model.tendon_adr[tendon]), []
            for wrap in range(first, first + int(model.tendon_num[tendon])):
                kind, thing = int(model.wrap_type[wrap]), int(model.wrap_objid[wrap])
                if kind == mujoco.mjtWrap.mjWRAP_JOINT:
                    points.append([int(model.jnt_bodyid[thing]), *model.jnt_pos[thing].tolist()])
                elif kind == mujoco.mjtWrap.mjWRAP_SITE:
                    points.append([int(model.site_bodyid[thing]), *model.site_pos[thing].tolist()])
            if len(points) > 1:
                found.append({"name": str(model.tendon(tendon).name), "points": points})
        return found

    def poses(self, reading_rad: np.ndarray) -> np.ndarray:
        """(b, 7) m and unit quaternions (w, x, y, z) for readings (j,) rad; unknown joints (NaN) stand at zero."""
        twin, data = self._twin, self._data
        data.qpos[:] = twin.initial_qpos(twin.measurement.invert(twin.joints, reading_rad))
        mujoco.mj_kinematics(twin.model, data)
        return np.concatenate([data.xpos, data.xquat], axis=1)


def _colour(model: mujoco.MjModel, geom: int) -> list[float]:
    material = int(model.geom_matid[geom])
    rgba = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return [round(float(value), 4) for value in rgba]


def _mesh(model: mujoco.MjModel, mesh: int) -> dict[str, str]:
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    points = model.mesh_vert[first : first + count].astype("<f4")
    first, count = int(model.mesh_faceadr[mesh]), int(model.mesh_facenum[mesh])
    faces = model.mesh_face[first : first + count].astype("<u4")
    return {"points": base64.b64encode(points.tobytes()).decode(), "faces": base64.b64encode(faces.tobytes()).decode()}
