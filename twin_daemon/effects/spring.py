"""A linear spring at a joint, with a preload."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_joint_tendon

_SLACK = 1e-8  # N m/rad: the weakest spring that can still hold a preload

_LEAST_SHARE = 0.003  # of the servo's stiffness: a start that only pulls
_SHARES = (1.0, 0.3, 0.1)  # of the line through the error


class Spring(Effect):
    """Torque preload - stiffness * q, as a fixed tendon of its own: the joint's own spring stays what it is."""

    key = "spring"
    title = "a spring or a constant pull at the joint"
    acts_on = "joint"
    rank = 130
    parameters = (
        Parameter(
            "stiffness", "N m/rad", 0.0, 50.0, 0.0, 0.3, "stiffness beside the model's own", reach=Reach("kp", 5.0)
        ),
        Parameter(
            "preload",
            "N m",
            -5.0,
            5.0,
            0.0,
            0.05,
            "torque at angle 0; above 0 it turns towards larger angles",
            reach=Reach("kp", 0.5),
        ),
    )
    story = Story(
        what="A torque that depends on the angle alone: a constant pull and a part in proportion to the angle.",
        shows="An error at rest that is the same on the way in and on the way out and changes along the travel.",
        cause="A return spring, a stiff cable or skin, an uneven pretension of the two tendons of a joint.",
        remedy="Balance the tendons' pretension, reroute the cable, check the return spring.",
        excitation="holds at several angles across the range, each reached from both sides",
    )
    reads_nominal_error = True
    amplitudes = ("stiffness", "preload")
    confusable = ("gravity_tilt", "payload", "actuator_gain", "sensor_gain", "sensor_offset", "nonlinear_spring")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        stiffness = values["stiffness"] + _SLACK
        rest = values["preload"] / stiffness
        add_joint_tendon(spec, f"{place.joint}_spring", {place.joint: 1.0}, stiffness=stiffness, rest=(rest, rest))

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The line through the torque over the angle; the servo is a spring that shows the torque as an error.

        At its limit of torque a servo shows far more than that, so that a part of it is a start as well.
        """
        slope, pull = np.polyfit(seen.angle, seen.gap, 1)
        stiffness, preload = scale.kp * max(-float(slope), _LEAST_SHARE), scale.kp * float(pull)
        line = [{"stiffness": share * stiffness, "preload": share * preload} for share in _SHARES]
        return (*line, *self.starts(scale))

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        k, pull = 0.03 * scale.kp, 0.01 * scale.kp
        return (
            {"stiffness": k, "preload": 0.0},
            {"stiffness": 0.1 * k, "preload": pull},
            {"stiffness": 0.1 * k, "preload": -pull},
            {"stiffness": 3.0 * k, "preload": k},
        )
