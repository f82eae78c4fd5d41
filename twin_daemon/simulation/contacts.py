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
    return {pair for pairs in _distances_m(twin, found, poses, 0.0) for pair in pairs}


def touching_times(
    twin: TwinModel, found: Sequence[Part], poses: np.ndarray, margin_m: float
) -> Mapping[str, tuple[np.ndarray, np.ndarray]]:
    """((n,), (n,)) bool by part: when something is near it, and when touches it, in true poses (n, j) rad in order.

    Near is what is within a margin. A touch lasts as long as the two are near, as no shape is better known.
    """
    near, touched = ({part.name: np.zeros(len(poses), bool) for part in found} for _ in range(2))
    apart: dict[frozenset[str], np.ndarray] = {}
    for index, pairs in enumerate(_distances_m(twin, found, poses, margin_m)):
        for pair, distance_m in pairs.items():
            apart.setdefault(pair, np.full(len(poses), np.inf))[index] = distance_m
    for pair, distances_m in apart.items():
        within = np.isfinite(distances_m)
        touching = _runs_with(within, distances_m <= 0.0)
        for name in pair & near.keys():
            near[name] |= within
            touched[name] |= touching
    return {name: (near[name], touched[name]) for name in near}


def _runs_with(near: np.ndarray, touch: np.ndarray) -> np.ndarray:
    """(n,) bool: the runs of `near` (n,) that have a `touch` (n,) in them."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int))).reshape(-1, 2)
    found = np.zeros(len(near), bool)
    for begin, end in edges:
        found[begin:end] = touch[begin:end].any()
    return found


def _distances_m(
    twin: TwinModel, found: Sequence[Part], poses: np.ndarray, margin_m: float
) -> Iterator[dict[frozenset[str], float]]:
    """For each pose how far apart the pairs of parts are that are within the margin: negative where they overlap."""
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
        pairs: dict[frozenset[str], float] = {}
        if model.ngeom:
            known = np.isfinite(pose)
            data.qpos[addresses[known]] = pose[known]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_collision(model, data)
            for touch in touches(model, data):
                pair = frozenset(of_body[body] for body in touch.bodies)
                pairs[pair] = min(touch.distance_m, pairs.get(pair, np.inf))
        yield pairs
