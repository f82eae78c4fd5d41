"""The motor and its amplifier: gain, limits, silence near the target, cogging, heat, pulling better than releasing."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..dice import chance, log_uniform, sign
from .base import Law, ServoLaw


class Gain(Law):
    """All of the servo's torque times a factor."""

    key = "actuator_gain"
    at = "servo"
    sizes = (2e-3, 1.5)

    def draw(self, random: np.random.Generator) -> None:
        self._way = 1.0 if chance(random, 0.3) else -1.0

    def values(self) -> dict[str, float]:
        return {"factor": float(np.exp(self._way * self.size))}

    def nominal_change(self) -> float | None:
        return self.size

    def edit(self, spec: Any) -> None:
        actuator, factor = self.actuator_of(spec), self.values()["factor"]
        actuator.gainprm[0] *= factor
        actuator.biasprm[1:3] = np.asarray(actuator.biasprm[1:3]) * factor


class Saturation(Law):
    """The servo's torque is cut below what the motion asks for."""

    key = "actuator_saturation"
    at = "servo"
    sizes = (0.02, 3.0)

    def values(self) -> dict[str, float]:
        return {"limit": self.site.peak * float(np.exp(-self.size))}

    def edit(self, spec: Any) -> None:
        limit = self.values()["limit"]
        self.actuator_of(spec).forcerange = [-limit, limit]


class DeadZone(ServoLaw):
    """A controller that is silent while the error is small, and counts it from the edge of the band outside of that."""

    key = "dead_zone"
    sizes = (1e-4, 0.3)

    def values(self) -> dict[str, float]:
        return {"band": self.size * self.site.unit}

    def step(self, target: np.ndarray) -> None:
        angle, speed = self.length()
        error = float(target[self.site.servo]) - angle
        left = abs(error) - self.size * self.site.unit
        if left > 0:
            self.pull(self.torque(np.sign(error) * left, speed))


class Ripple(Law):
    """Cogging: amplitude * sin(periods * angle + phase), `periods` a turn."""

    key = "torque_ripple"
    at = "lone"
    each_step = True
    sizes = (1e-4, 3.0)
    drift_rad_s = 0.0

    def draw(self, random: np.random.Generator) -> None:
        self._waves = float(random.integers(8, 40))
        if self.site.unit < 1:
            self._waves = float(round(2 * np.pi * log_uniform(random, 4, 12) / self.site.span))
        self._phase = float(random.uniform(-np.pi, np.pi))

    def values(self) -> dict[str, float]:
        return {"amplitude": self.size * self.site.torque, "periods": self._waves}

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._amplitude = self.size * self.site.torque

    def step(self, target: np.ndarray) -> None:
        joint = self.site.joint
        phase = self._waves * float(self.data.qpos[joint]) + self._phase + self.drift_rad_s * float(self.data.time)
        self.data.qfrc_applied[joint] += self._amplitude * float(np.sin(phase))


class DriftingRipple(Ripple):
    """Cogging of a motor that slips on its shaft: its phase wanders."""

    key = "x_drifting_cogging"

    def draw(self, random: np.random.Generator) -> None:
        super().draw(random)
        self.drift_rad_s = sign(random) * log_uniform(random, 0.4, 2.0)

    def values(self) -> dict[str, float]:
        return {}


class Fading(ServoLaw):
    """Copper warms with the square of the torque, and the servo fades: one thermal mass."""

    key = "x_fading_servo"
    sizes = (5e-3, 3.0)

    def draw(self, random: np.random.Generator) -> None:
        self._warms_s = float(random.uniform(4, 12))

    def begin(self, model: Any, data: Any, step_s: float) -> None:
        super().begin(model, data, step_s)
        self._heat = 0.0

    def step(self, target: np.ndarray) -> None:
        angle, speed = self.length()
        share = float(np.exp(-self.size * self._heat / (1 + self._heat)))
        torque = share * self.torque(float(target[self.site.servo]) - angle, speed)
        self._heat += self.step_s / self._warms_s * ((3 * torque / self.site.peak) ** 2 - self._heat)
        self.pull(torque)


class LooseTendon(ServoLaw):
    """A tendon that is slack on one side: it pulls one way at once, the other way only behind a gap.

    In position data that is a servo which is silent within half of the gap about a zero that is off by the other half.
    """

    key = "x_loose_tendon"
    composed = (("dead_zone", "backlash"), ("sensor_offset", "spring"))
    sizes = (1e-4, 0.4)

    def draw(self, random: np.random.Generator) -> None:
        self._slack = sign(random)

    def step(self, target: np.ndarray) -> None:
        angle, speed = self.length()
        error = float(target[self.site.servo]) - angle
        if error * self._slack > 0:
            error = self._slack * max(abs(error) - self.size * self.site.unit, 0.0)
        self.pull(self.torque(error, speed))
