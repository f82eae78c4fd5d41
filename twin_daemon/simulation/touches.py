"""What touches what in a model's data."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True)
class Touch:
    """Two bodies at a contact. `distance_m` is negative where they overlap; `position_m` (3,) in the world frame."""

    bodies: tuple[int, int]
    distance_m: float
    position_m: np.ndarray


def touches(model: mujoco.MjModel, data: mujoco.MjData) -> Iterator[Touch]:
    """The contacts between geoms that the last collision pass left; those of flexes have no geoms and are left out."""
    for number in range(data.ncon):
        geoms = data.contact.geom[number]
        if min(geoms) >= 0:
            first, second = (int(model.geom_bodyid[geom]) for geom in geoms)
            yield Touch((first, second), float(data.contact.dist[number]), data.contact.pos[number])


def dofs_that_move(model: mujoco.MjModel) -> np.ndarray:
    """(nbody, nv) whether a degree of freedom moves a body."""
    moves = np.zeros((model.nbody, model.nv), dtype=bool)
    for body in range(1, model.nbody):
        first = model.body_dofadr[body]
        moves[body] = moves[model.body_parentid[body]]
        moves[body, first : first + model.body_dofnum[body]] = True
    return moves
