"""The joint meets something before its end of travel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_joint_tendon

_EDGES = (0.05, 0.005)  # of the samples from either end: a joint that stands at a stop does so for at least that share
_STIFF = 4.0  # times the servo's stiffness
_RANGE = Reach("span", 1.0)
_RARE = np.array([0.005, 0.01, 0.02, 0.03])
# quantiles of the angle at which a stop may begin: one that only the widest motion meets is met in few samples
_BEGINNINGS = np.concatenate([_RARE, np.arange(0.05, 1.0, 0.05), 1.0 - _RARE[::-1]])


class JointStop(Effect):
    """An elastic stop at one or both ends: a fixed tendon that is slack inside a band and a spring outside it."""

    key = "joint_stop"
    title = "an early or soft stop"
    acts_on = "joint"
    rank = 170
    parameters = (
        Parameter(
            "stiffness",
            "N m/rad",
            0.0,
            1000.0,
            0.0,
            10.0,
            "stiffness of the stops; at 0 there are none",
            reach=Reach("kp", 100.0),
        ),
        Parameter("upper", "rad", -0.5, 3.0, 0.0, 0.8, "where it begins, this much before the upper end", reach=_RANGE),
        Parameter("lower", "rad", -0.5, 3.0, 0.0, 0.0, "where it begins, this much after the lower end", reach=_RANGE),
    )
    story = Story(
        what="Beyond an angle something elastic pushes back.",
        shows="The joint is healthy over part of its range and stops short, softly, near one end.",
        cause="Foreign matter, a cable or glove in the way, a bent end stop, swollen padding.",
        remedy="Look for what blocks the joint at that angle.",
        excitation="slow motion across the whole range, with holds near both ends",
    )
    confusable = ("nonlinear_spring", "spring", "sensor_gain", "actuator_saturation")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        joint = spec.joint(place.joint)
        low, high = joint.range if joint.range[0] < joint.range[1] else (-np.pi, np.pi)
        first, last = low + values["lower"], high - values["upper"]
        if first > last:  # the stops overlap: both push towards the middle
            first = last = 0.5 * (first + last)
        add_joint_tendon(
            spec, f"{place.joint}_stop", {place.joint: 1.0}, stiffness=values["stiffness"], rest=(first, last)
        )

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        span, k = scale.span, 2.0 * scale.kp
        return (
            {"stiffness": k, "upper": 0.2 * span, "lower": 0.0},
            {"stiffness": k, "upper": 0.5 * span, "lower": 0.0},
            {"stiffness": k, "upper": 0.0, "lower": 0.2 * span},
            {"stiffness": 0.2 * k, "upper": 0.4 * span, "lower": 0.0},
        )

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Where the error begins to grow, at either end: at rest a stop bends the servo by its stiffness over kp.

        A stiff stop is hardly entered, so that the joint stands at its edge: at either end of what is seen of the angle
        one such is suggested as well.
        """
        angle, gap = seen.angle, seen.gap
        found: list[tuple[float, dict[str, float]]] = []
        for side in (1.0, -1.0):
            best = 0.0, 0.0, 0.0
            for begins in np.quantile(angle, _BEGINNINGS):
                beyond = np.maximum(side * (angle - begins), 0.0)
                power = float(beyond @ beyond)
                pushed = -side * float(gap @ beyond)
                if power > 0.0 and pushed > 0.0:
                    best = max(best, (pushed**2 / power, float(begins), pushed / power))
            taken, begins, slope = best
            if taken > 0.0:
                place = {"upper": scale.upper - begins, "lower": 0.0} if side > 0 else {"lower": begins - scale.lower}
                found.append((taken, {"stiffness": slope * scale.kp, "upper": 0.0, **place}))
        found.sort(key=lambda one: -one[0])
        stands = {"stiffness": _STIFF * scale.kp, "upper": 0.0, "lower": 0.0}
        edges: list[dict[str, float]] = []
        for share in _EDGES:
            low, high = np.quantile(angle, (share, 1.0 - share))
            edges.append(stands | {"upper": scale.upper - float(high)})
            edges.append(stands | {"lower": float(low) - scale.lower})
        return (*(values for _, values in found), *edges)
