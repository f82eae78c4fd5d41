"""The servo follows its command through a first-order filter."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Seen, Story
from twin_daemon.effects.edits import require_free_dynamics

_FLOOR_S = 1e-5  # exp(-step / floor) is 0 for every usual step: the filter is then transparent


class ActuatorLag(Effect):
    """Command through a first-order filter, integrated exactly and used in the same step (`filterexact`)."""

    key = "actuator_lag"
    title = "the servo reacts slowly"
    acts_on = "actuator"
    rank = 100
    shared = "servos"
    excludes = ("rate_limit",)
    reads_nominal_error = True
    parameters = (Parameter("tau", "s", 0.0, 2.0, 0.0, 0.03, "time constant of the filter on the command"),)
    story = Story(
        what="The command reaches the motor smoothed: it is followed with a time constant.",
        shows="Motion that starts at once but gently, and lags by a constant time at constant speed.",
        cause="A filter in the controller or the driver, slow valves or slow muscles.",
        remedy="Look for a filter setting in the controller.",
        excitation="steps beside ramps: a step tells a filter from a pure delay",
    )
    confusable = ("command_delay", "viscous_friction", "rate_limit", "armature")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        actuator = spec.actuator(place.actuator)
        require_free_dynamics(actuator, place, self.key)
        actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
        actuator.dynprm[0] = max(values["tau"], _FLOOR_S)
        actuator.actearly = True

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The time by which the whole motion is late: slow motion lags by the time constant."""
        return tuple({"tau": share * seen.late_s} for share in (1.0, 0.5, 2.0)) if seen.late_s > 0.0 else ()

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"tau": tau} for tau in (0.01, 0.05, 0.2))
