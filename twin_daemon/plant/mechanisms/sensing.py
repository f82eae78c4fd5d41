"""The sensor and its wiring: zero, scale, a neighbour's field, and an encoder that hangs."""

from __future__ import annotations

import numpy as np

from .base import Mechanism


class _OnSensors(Mechanism):
    stages = ("sense",)

    def prepare(self) -> None:
        self.rows = self.joint_rows()


class SensorOffset(_OnSensors):
    """A magnet glued on askew: `value` rad is added."""

    def sense(self, time_s: float, position: np.ndarray) -> None:
        position[self.rows] += self.value


class SensorGain(_OnSensors):
    """A wrong calibration slope, about the angle 0."""

    def sense(self, time_s: float, position: np.ndarray) -> None:
        position[self.rows] *= self.value


class Crosstalk(_OnSensors):
    """The neighbour's magnet is seen: `value` of its angle leaks in. The neighbour is the next joint to the tip."""

    def prepare(self) -> None:
        super().prepare()
        parent, bodies = self.rig.model.body_parentid, list(self.rig.body_of)
        outward = {int(parent[body]): row for row, body in reversed(list(enumerate(bodies)))}
        inward = {int(body): row for row, body in enumerate(bodies)}
        self._neighbours = np.array(
            [
                outward.get(int(bodies[row]), inward.get(int(parent[bodies[row]]), (int(row) + 1) % len(bodies)))
                for row in self.rows
            ]
        )

    def sense(self, time_s: float, position: np.ndarray) -> None:
        position[self.rows] += self.value * position[self._neighbours]


class SensorStick(_OnSensors):
    """Now and then the encoder repeats its last value for `hold` s; `value` is the share of time, by its own dice."""

    def reset(self) -> None:
        self._kept = np.full(len(self.rows), np.nan)
        self._slot = np.full(len(self.rows), -1)
        self._dice = np.ones(len(self.rows))

    def sense(self, time_s: float, position: np.ndarray) -> None:
        slots = np.floor(time_s / self.more["hold"]).astype(int)
        for i in np.flatnonzero(slots != self._slot):
            seed = [self.rig.seed, 4, int(self.rows[i]), int(slots[i])]
            self._dice[i] = np.random.default_rng(seed).random()
        self._slot = slots
        stuck = (self._dice < self.value) & np.isfinite(self._kept)
        self._kept = np.where(stuck, self._kept, position[self.rows])
        position[self.rows] = self._kept
