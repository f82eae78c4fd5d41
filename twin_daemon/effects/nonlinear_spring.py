"""A spring that stiffens."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_joint_tendon

_CENTRES = 25  # at which a cubic through the torque is tried


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
        Parameter(
            "centre",
            "rad",
            -np.pi,
            np.pi,
            0.0,
            0.0,
            "angle at which it does not pull",
            reach=Reach("span", 1.0),
            place=True,
        ),
    )
    story = Story(
        what="An elastic torque that is weak near its centre and steep away from it.",
        shows="An error at rest that grows faster than the angle towards one or both ends of the range.",
        cause="A skin or a cable that is taut only near the ends; a rubber part.",
        remedy="Reroute the cable, loosen the skin.",
        excitation="holds at many angles across the whole range",
    )
    reads_nominal_error = True
    confusable = ("spring", "joint_stop", "sensor_gain")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        centre = values["centre"]
        tendon = add_joint_tendon(spec, f"{place.joint}_cubic", {place.joint: 1.0}, rest=(centre, centre))
        tendon.stiffness[2] = values["cubic"]

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The cubics that fit the torque over the angle best: the servo is a spring that shows it as an error."""
        angle, gap = seen.angle, seen.gap
        low, high = float(angle.min()), float(angle.max())
        margin = 0.25 * (high - low)
        found = []
        for centre in np.linspace(low - margin, high + margin, _CENTRES):
            pull = -((angle - centre) ** 3)
            cubic = scale.kp * max(float(pull @ gap) / max(float(pull @ pull), 1e-30), 0.0)
            found.append((float(((gap - cubic / scale.kp * pull) ** 2).sum()), cubic, float(centre)))
        left = np.array([cost for cost, _, _ in found])
        beside = np.pad(left, 1, constant_values=np.inf)
        dips = np.flatnonzero((left <= beside[:-2]) & (left <= beside[2:]))
        best = dips[np.argsort(left[dips])][:2]
        return tuple({"cubic": found[i][1], "centre": found[i][2]} for i in best if found[i][1] > 0.0)

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
