"""When a hand touches itself, by the model's own geometry."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np

from twin_daemon.simulation.submodel import Part, upwards
from twin_daemon.simulation.touches import touches
from twin_daemon.simulation.twin import TwinModel


def touching_parts(twin: TwinModel, found: Sequence[Part], poses: np.ndarray) -> set[frozenset[str]]:
    """Pairs of parts (by name) that touch in any of the true poses (n, j) rad; a part that touches itself or the
    trunk comes alone."""
    return set().union(*_touches(twin, found, poses, 0.0))


def touching_times(
    twin: TwinModel, found: Sequence[Part], poses: np.ndarray, margin_m: float
) -> Mapping[str, np.ndarray]:
    """(n,) bool by part: in which of the true poses (n, j) rad it comes within a margin of anything."""
    masks = {part.name: np.zeros(len(poses), bool) for part in found}
    for index, pairs in enumerate(_touches(twin, found, poses, margin_m)):
        for name in {name for pair in pairs for name in pair} & masks.keys():
            masks[name][index] = True
    return masks


def _touches(
    twin: TwinModel, found: Sequence[Part], poses: np.ndarray, margin_m: float
) -> Iterator[set[frozenset[str]]]:
    model = twin.base_model
    if margin_m and model.ngeom:
        model = twin.base_model.__copy__()
        model.geom_margin[:] = np.maximum(model.geom_margin, margin_m)
    data = mujoco.MjData(model)
    owner = {}
    for part in found:
        for name in part.joints:
            owner[int(model.joint(twin.hand.description.joints[name].joint).bodyid[0])] = part.name
    of_body = [next((owner[b] for b in upwards(model, body) if b in owner), "trunk") for body in range(model.nbody)]
    addresses = np.array(
        [int(model.joint(twin.hand.description.joints[n].joint).qposadr[0]) for n in twin.joints], dtype=int
    )
    for pose in poses:
        pairs: set[frozenset[str]] = set()
        if model.ngeom:
            known = np.isfinite(pose)
            data.qpos[addresses[known]] = pose[known]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            pairs = {frozenset(of_body[body] for body in touch.bodies) for touch in touches(model, data)}
        yield pairs
