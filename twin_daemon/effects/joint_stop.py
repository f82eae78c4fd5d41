"""The joint meets something before its end of travel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Story
from twin_daemon.effects.edits import add_joint_tendon


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
        Parameter("upper", "rad", -0.5, 3.0, 0.0, 0.8, "where it begins, this much before the upper end"),
        Parameter("lower", "rad", -0.5, 3.0, 0.0, 0.0, "where it begins, this much after the lower end"),
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
        span, k = scale.upper - scale.lower, 2.0 * scale.kp
        return (
            {"stiffness": k, "upper": 0.2 * span, "lower": 0.0},
            {"stiffness": k, "upper": 0.5 * span, "lower": 0.0},
            {"stiffness": k, "upper": 0.0, "lower": 0.2 * span},
            {"stiffness": 0.2 * k, "upper": 0.4 * span, "lower": 0.0},
        )
