"""A controller that is silent near its target."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Seen, Story
from twin_daemon.effects.silence import silent_within
from twin_daemon.effects.transmission import MOTOR_SHARE


class DeadZone(Effect):
    """The servo acts on `joint + s`, where `s` yields to it freely within the band: torque = stiffness * (error - s).

    So it pulls with nothing inside of the band and with its own stiffness, from zero, outside of it, within the limits
    that it has.

    Play behind a motor that weighs nothing is the same law, as within its gap such a motor goes to the target at once:
    backlash with a small `motor_share`, or `braked`. Only a motor whose own inertia and damping show tells them apart.
    """

    key = "dead_zone"
    title = "a controller that is silent near its target"
    acts_on = "actuator"
    rank = 230
    neutral_within_rad = 5e-4  # a closed band is a very stiff one: see above
    parameters = (Parameter("band", "rad", 0.0, 0.5, 0.0, 0.03, "error, either way, up to which it gives no torque"),)
    story = Story(
        what="The controller gives no torque while the joint is within a band about its target.",
        shows="The joint comes to rest anywhere within the band, on the side that it came from or where its load pulls "
        "it, and lags by the band while it moves.",
        cause="A dead zone among the controller's settings, as low-cost servos have it so that they do not hum.",
        remedy="Set the controller's dead zone smaller, or add integral action; command past the target where neither "
        "can be had.",
        excitation="holds reached from both sides, under two loads",
    )
    limit_of = ("backlash",)
    confusable = ("backlash", "coulomb_friction", "hysteresis", "sensor_offset")

    def as_limit_of(self, values: Mapping[str, float]) -> dict[str, float]:
        """A band as wide as the play."""
        return {"band": 0.5 * values["gap"]}

    def as_law_at_limit(self, values: Mapping[str, float]) -> dict[str, float]:
        """Play of a motor that weighs nothing. Where the servo brakes, it brakes within the gap as well."""
        return {"gap": 2.0 * values["band"], "motor_share": MOTOR_SHARE.lower, "braked": 1.0}

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        silent_within(spec, place, values["band"])

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"band": band} for band in (0.01, 0.03, 0.1))

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Bands of the size of the error: at rest a joint lies up to the band from its target to either side."""
        low, high = np.percentile(seen.gap, [10.0, 90.0])
        size = 0.5 * float(high - low)
        return tuple({"band": share * size} for share in (0.5, 1.0, 2.0)) if size > 0.0 else ()
