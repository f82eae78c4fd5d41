"""The sensor: its zero, its scale, a shaft that is not in the middle, a neighbour that leaks in."""

from __future__ import annotations

import numpy as np

from ..dice import log_uniform, sign
from .base import Law


class _OnReading(Law):
    def sense(self, times: np.ndarray, angles: np.ndarray) -> np.ndarray:
        out = angles.copy()
        out[:, self.site.joint] = self.read(angles[:, self.site.joint], angles)
        return out

    def read(self, angle: np.ndarray, angles: np.ndarray) -> np.ndarray:
        """(n,) reading of the joint from its own angle and everybody's (n, j)."""
        raise NotImplementedError


class Offset(_OnReading):
    """The sensor's zero is off."""

    key = "sensor_offset"
    sizes = (1e-6, 0.5)

    def draw(self, random: np.random.Generator) -> None:
        self._way = sign(random)

    def values(self) -> dict[str, float]:
        return {"offset": self._way * self.size * self.site.unit}

    def read(self, angle: np.ndarray, angles: np.ndarray) -> np.ndarray:
        return angle + self.values()["offset"]


class Scale(_OnReading):
    """The sensor's scale is off."""

    key = "sensor_gain"
    sizes = (1e-5, 0.7)

    def draw(self, random: np.random.Generator) -> None:
        self._way = sign(random)

    def values(self) -> dict[str, float]:
        return {"factor": float(np.exp(self._way * self.size))}

    def read(self, angle: np.ndarray, angles: np.ndarray) -> np.ndarray:
        return angle * self.values()["factor"]


class Eccentric(_OnReading):
    """A magnet that runs out of true: the reading waves with the angle."""

    key = "x_eccentric_sensor"
    sizes = (1e-5, 0.3)

    def draw(self, random: np.random.Generator) -> None:
        self._waves = 2 * np.pi * log_uniform(random, 1.5, 5.0) / self.site.span  # over the travel
        self._phase = float(random.uniform(-np.pi, np.pi))

    def read(self, angle: np.ndarray, angles: np.ndarray) -> np.ndarray:
        return angle + self.size * self.site.unit * np.sin(self._waves * angle + self._phase)


class Crosstalk(_OnReading):
    """Another joint's motion leaks into the reading."""

    key = "x_crosstalk"
    sizes = (1e-5, 0.6)

    def draw(self, random: np.random.Generator) -> None:
        others = [index for index in range(len(self.site.robot.joints)) if index != self.site.joint]
        self._other = int(random.choice(others)) if others else self.site.joint
        column = self.site.others[:, self._other]
        self._middle, self._factor = float(column.mean()), sign(random) * self.site.span / float(np.ptp(column))

    def read(self, angle: np.ndarray, angles: np.ndarray) -> np.ndarray:
        return angle + self.size * self._factor * (angles[:, self._other] - self._middle)
