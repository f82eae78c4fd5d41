"""A twin that is told where to be, and nothing else."""

from __future__ import annotations

import numpy as np

from twin_daemon.simulation.rollout import roll_out
from twin_daemon.simulation.twin import TwinModel


def follow(twin: TwinModel, names: tuple[str, ...], targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Controls (T, nu) and true positions (T, j) rad under targets (T, k) rad, one a time step of the model.

    It begins at the model's own configuration; what the targets leave out is held at 0.
    """
    controls = twin.controls(names, targets, np.zeros(len(twin.actuators)))
    start = twin.initial_qpos(np.full(len(twin.joints), np.nan), controls[0])
    positions = roll_out([twin.model], controls[None], start[None])[0]
    return controls, positions[: len(controls), twin.qpos_adr]
