"""The servo is stiffer or softer than the model says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story
from twin_daemon.effects.edits import servo_damping


class ActuatorGain(Effect):
    """A factor on the servo's gain and bias together, and one on its torque limit where it has one.

    A setting of the controller changes the gain alone; a motor that lost magnetisation, or a supply that sags, takes
    the limit along. A derivative gain goes along where the torque of the servo is weaker, and stays where only the
    proportional gain was set: `derivative` is how much of it stays. On its own it is viscous friction.
    """

    key = "actuator_gain"
    title = "a weaker (or stronger) servo"
    acts_on = "actuator"
    rank = 70
    shared = "servos"
    stands_for = "kp"
    parameters = (
        Parameter("factor", "1", 0.01, 100.0, 1.0, 0.6, "servo torque over the model's", log=True),
        Parameter("limit", "1", 0.01, 100.0, 1.0, 1.0, "the servo's torque limit over the model's", log=True),
        Parameter("derivative", "1", 0.0, 1.0, 0.0, 0.0, "how much its derivative gain stays behind the factor"),
    )
    story = Story(
        what="The servo answers an error with less (or more) torque than it should.",
        shows="More sag under load, more error at rest from friction, more lag; all by one factor.",
        cause="A motor that lost magnetisation, a low supply voltage, another controller setting.",
        remedy="Check the controller's gains and the supply; compare the motor with its neighbour.",
        excitation="holds under load and steps, at two speeds",
    )
    amplitudes = ("factor", "limit")
    contains = ("actuator_saturation",)
    confusable = ("viscous_friction", "spring", "actuator_saturation", "tendon_elasticity", "payload")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        actuator = spec.actuator(place.actuator)
        damping = servo_damping(spec, place)  # of the gain that it has yet: it may be given as a damping ratio
        actuator.gainprm = actuator.gainprm * values["factor"]
        actuator.biasprm = actuator.biasprm * values["factor"]
        actuator.biasprm[2] = -damping * values["factor"] ** (1.0 - values["derivative"])
        actuator.forcerange = np.asarray(actuator.forcerange) * values["limit"]

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        alike = tuple({"factor": factor, "limit": factor} for factor in (0.7, 0.35, 1.5))
        set_alone = tuple({"factor": factor, "limit": 1.0} for factor in (0.7, 0.35))
        if scale.kv <= 0.0:
            return (*alike, *set_alone)
        return (*alike, *set_alone, *({**values, "derivative": 1.0} for values in set_alone))

    def as_factor(self, factor: float) -> dict[str, float]:
        """A nominal `kp` is the proportional gain alone."""
        return super().as_factor(factor) | {"derivative": 1.0}

    def bounds(self, scale: Scale) -> dict[str, tuple[float, float]]:
        """Where each is looked for at a place; a servo without a derivative gain has none to be off."""
        found = super().bounds(scale)
        return found if scale.kv > 0.0 else found | {"derivative": (0.0, 0.0)}
