"""Commands reach the servo late."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Seen, Story

_LONGEST_S = 0.2


class CommandDelay(Effect):
    """The actuator's `delay`, read between samples by linear interpolation (MuJoCo manual, Delays).

    MuJoCo reads a command before it stores it, so that any delay above 0 is at least one time step.
    """

    key = "command_delay"
    title = "the command arrives late"
    acts_on = "actuator"
    rank = 90
    shared = "servos"
    reads_nominal_error = True
    parameters = (Parameter("delay", "s", 0.0, _LONGEST_S, 0.0, 0.02, "age of the command that the servo uses"),)
    story = Story(
        what="The servo uses a command that is some time old.",
        shows="The whole motion is late by one constant time, steps and ramps alike, with nothing else changed.",
        cause="Communication, buffering, a slow control loop.",
        remedy="Look for queues and cycle times between the sender and the driver.",
        excitation="steps at known times: a pure delay keeps their shape",
    )
    confusable = ("actuator_lag", "viscous_friction", "rate_limit")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        actuator = spec.actuator(place.actuator)
        actuator.nsample = int(np.ceil(_LONGEST_S / spec.option.timestep)) + 1
        actuator.interp = 1  # linear: the motion is continuous in the delay
        actuator.delay = values["delay"]

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The time by which the whole motion is late."""
        return tuple({"delay": share * seen.late_s} for share in (1.0, 0.5, 2.0)) if seen.late_s > 0.0 else ()

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"delay": delay} for delay in (0.008, 0.03, 0.07, 0.15))
