"""The motor cannot pull harder than this."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story

_UNLIMITED = 1e6
_STARTS = 6  # each at most twice the next, where a servo has ten times what it needs


class ActuatorSaturation(Effect):
    """A limit on the servo's torque, as `forcerange`; where the model has a smaller one, that one stays."""

    key = "actuator_saturation"
    title = "the servo runs into a torque limit"
    acts_on = "actuator"
    rank = 80
    parameters = (
        Parameter("limit", "N m", 1e-6, _UNLIMITED, _UNLIMITED, 0.15, "largest torque, either way", log=True),
    )
    story = Story(
        what="The servo's torque stops growing with the error.",
        shows="Fast motion is cut to a constant speed and small errors look healthy; heavy loads are dropped.",
        cause="A current or torque limit in the driver, a weak supply, a slipping tendon drum.",
        remedy="Check the driver's current limit and the supply.",
        excitation="large steps beside slow motion, both with load",
    )
    confusable = ("actuator_gain", "rate_limit", "viscous_friction")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        actuator = spec.actuator(place.actuator)
        low, high = actuator.forcerange
        if low == high:  # the model has none
            low, high = -_UNLIMITED, _UNLIMITED
        limit = values["limit"]
        actuator.forcerange = np.array([max(low, -limit), min(high, limit)])
        actuator.forcelimited = True

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        # between what the servo has and a hundredth of what an error of a radian asks for
        limits = np.geomspace(0.6 * scale.force_nm, 0.1 * min(scale.force_nm, 0.1 * scale.kp), _STARTS)
        return tuple({"limit": float(limit)} for limit in limits)
