"""The mirrored hand in space: where its fingertips are, what it touches, how long its tendons are."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from twin_daemon.daemon.messages import number
from twin_daemon.simulation.touches import dofs_that_move, touches
from twin_daemon.simulation.twin import TwinModel


class Kinematics:
    """The geometry of a model at measured joint angles. Computed when somebody asks, not at every sample."""

    def __init__(self, twin: TwinModel) -> None:
        self._twin = twin
        self._data = mujoco.MjData(twin.model)
        self._tips = _tips(twin.model)

    def at(self, reading_rad: np.ndarray) -> dict[str, Any]:
        """What measured readings (j,) rad mean in space; joints that were never heard (NaN) stand at 0.

        Positions in m in the world's frame, quaternions as w x y z, tendon lengths in the tendon's unit, contact
        distances in m (negative where bodies overlap).
        """
        model, data = self._twin.model, self._data
        angle = self._twin.measurement.invert(self._twin.joints, reading_rad)
        known = np.isfinite(angle)
        mujoco.mj_resetData(model, data)
        data.qpos[self._twin.qpos_adr[known]] = angle[known]
        mujoco.mj_forward(model, data)
        return {
            "complete": bool(known.all()),
            "fingertips": {
                model.body(body).name: {
                    "position_m": [number(x) for x in data.xpos[body]],
                    "quaternion": [number(x) for x in data.xquat[body]],
                }
                for body in self._tips
            },
            "contacts": [
                {
                    "bodies": [model.body(body).name for body in touch.bodies],
                    "distance_m": number(touch.distance_m),
                    "position_m": [number(x) for x in touch.position_m],
                }
                for touch in touches(model, data)
            ],
            "tendons": {model.tendon(i).name or str(i): number(data.ten_length[i]) for i in range(model.ntendon)},
        }


def _tips(model: mujoco.MjModel) -> list[int]:
    """The last body of each branch that a joint moves."""
    parents = {int(model.body_parentid[body]) for body in range(1, model.nbody)}
    moved = np.any(dofs_that_move(model), axis=1)
    return [body for body in range(1, model.nbody) if body not in parents and moved[body]]
