"""The servo's set point moves no faster than this."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Seen, Story
from twin_daemon.effects.edits import require_free_dynamics

_UNLIMITED = 1e4


class RateLimit(Effect):
    """A position servo as MuJoCo's `pid` actuator with `slewmax`; without velocity input or integral it is the same."""

    key = "rate_limit"
    title = "the command is limited in speed"
    acts_on = "actuator"
    rank = 110
    excludes = ("actuator_lag",)
    parameters = (
        Parameter("rate", "rad/s", 1e-5, _UNLIMITED, _UNLIMITED, 1.0, "fastest change of the set point", log=True),
    )
    story = Story(
        what="The set point follows the command no faster than a given speed.",
        shows="Fast commands become ramps of one slope; slow ones are followed as ever.",
        cause="A velocity limit in the controller or the driver.",
        remedy="Check the controller's velocity limit.",
        excitation="motion faster and slower than the limit",
    )
    confusable = ("actuator_saturation", "actuator_lag", "command_delay")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        actuator = spec.actuator(place.actuator)
        require_free_dynamics(actuator, place, self.key)
        actuator.dyntype = mujoco.mjtDyn.mjDYN_PID
        actuator.gaintype = mujoco.mjtGain.mjGAIN_PID
        actuator.gainprm = np.zeros(10)  # no integral action; the proportional gain is the bias
        actuator.dynprm = np.array([0.0, values["rate"], *np.zeros(8)])
        actuator.ctrlspec = 1  # a position set point

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The speeds that the joint reached: it stays at the limit for as long as the command is faster.

        A joint that overshoots was faster than the limit for a moment, so that slower ones are suggested as well, and
        faster ones, as a joint that takes longer to follow than the command to get there does not come to it.
        """
        if not seen.moving.size:
            return ()
        usual, fastest = (float(speed) for speed in np.quantile(seen.moving, (0.7, 0.99)))
        return tuple({"rate": rate} for rate in (2.2 * fastest, 1.5 * fastest, fastest, 0.7 * fastest, usual))

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"rate": rate} for rate in (0.3, 1.0, 3.0))
