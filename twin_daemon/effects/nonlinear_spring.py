"""A spring that stiffens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Story
from twin_daemon.effects.edits import add_joint_tendon


class NonlinearSpring(Effect):
    """Torque -cubic * (q - centre)^3, by the third coefficient of a fixed tendon's stiffness.

    MuJoCo's polynomial is the plain one, so that its second coefficient would not be odd; it stays 0.
    """

    key = "nonlinear_spring"
    title = "a spring that stiffens"
    acts_on = "joint"
    rank = 160
    parameters = (
        Parameter(
            "cubic", "N m/rad3", 0.0, 50.0, 0.0, 0.3, "torque at one radian from the centre", reach=Reach("kp", 5.0)
        ),
        Parameter("centre", "rad", -np.pi, np.pi, 0.0, 0.0, "angle at which it does not pull"),
    )
    story = Story(
        what="An elastic torque that is weak near its centre and steep away from it.",
        shows="An error at rest that grows faster than the angle towards one or both ends of the range.",
        cause="A skin or a cable that is taut only near the ends; a rubber part.",
        remedy="Reroute the cable, loosen the skin.",
        excitation="holds at many angles across the whole range",
    )
    confusable = ("spring", "joint_stop", "sensor_gain")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        centre = values["centre"]
        tendon = add_joint_tendon(spec, f"{place.joint}_cubic", {place.joint: 1.0}, rest=(centre, centre))
        tendon.stiffness[2] = values["cubic"]

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        reach = max(abs(scale.lower), abs(scale.upper), 0.1)
        cubic = 0.03 * scale.kp / reach**2
        middle = 0.5 * (scale.lower + scale.upper)
        return (
            {"cubic": cubic, "centre": 0.0},
            {"cubic": 1.5 * cubic, "centre": middle},
            {"cubic": 1.5 * cubic, "centre": scale.lower},
            {"cubic": 1.5 * cubic, "centre": scale.upper},
        )
