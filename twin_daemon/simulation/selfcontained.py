"""A model without files around it: meshes written into the MJCF itself."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np


def inline_meshes(spec: Any, model: mujoco.MjModel) -> Any:
    """A copy of the spec whose meshes are vertices and faces instead of paths to files.

    Textures stay behind with their files: they change nothing that moves. MuJoCo stores a mesh in its inertia
    frame; the vertices are moved back to the frame in which the file has them.
    """
    if not model.nmesh:
        return spec
    plain = spec.copy()
    for material in list(plain.materials):
        material.textures = [""] * len(material.textures)
    for texture in list(plain.textures):
        plain.delete(texture)
    for mesh in list(plain.meshes):
        compiled = model.mesh(mesh.name)
        first, count = int(compiled.vertadr[0]), int(compiled.vertnum[0])
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, model.mesh_quat[compiled.id])
        vertices = model.mesh_vert[first : first + count] @ rotation.reshape(3, 3).T + model.mesh_pos[compiled.id]
        face = int(compiled.faceadr[0])
        faces = model.mesh_face[face : face + int(compiled.facenum[0])]
        mesh.file = ""
        mesh.scale = [1.0, 1.0, 1.0]
        mesh.uservert = vertices.astype(np.float32).ravel()
        mesh.userface = faces.astype(np.int32).ravel()
    plain.meshdir = ""
    plain.texturedir = ""
    return plain
