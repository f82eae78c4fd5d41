"""Something that bends with the joint and then gives way."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_passive_motor, stable_stiffness

_FLOOR = 1e-9  # N m: the law divides by its torque


class Hysteresis(Effect):
    """Dahl's law (1968): an elastic torque that saturates, whatever the speed.

    It is the LuGre law of a `dcmotor` without input, with equal friction at rest and in motion. A spring with
    `springyield` would be the sharp-cornered form, but it has a rest angle: a model that starts anywhere else
    would begin with a kick. A bristle starts relaxed in every pose.
    """

    key = "hysteresis"
    title = "hysteresis: the past motion leaves a pull"
    acts_on = "joint"
    rank = 150
    dissipative = True
    parameters = (
        Parameter("torque", "N m", 0.0, 5.0, 0.0, 0.08, "torque at which it gives way", reach=Reach("kp", 0.5)),
        Parameter(
            "stiffness",
            "N m/rad",
            0.01,
            100.0,
            1.0,
            1.0,
            "stiffness before it gives way",
            log=True,
            reach=Reach("kp", 10.0),
        ),
    )
    story = Story(
        what="A part is bent by the motion until it slips; after a reversal it must be bent the other way first.",
        shows="Another angle at rest on the way in than on the way out, with a rounded transition after reversals.",
        cause="Cables and skins that creep, sheaths that flex before the tendon slides in them.",
        remedy="Reroute cables, renew the sheath, grease the tendon.",
        excitation="reversals of several sizes, small ones within the transition",
    )
    confusable = ("coulomb_friction", "backlash", "stribeck_friction", "load_friction")
    contains = ("coulomb_friction",)

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        stiffness = min(values["stiffness"], stable_stiffness(spec, place))
        torque = values["torque"] + _FLOOR
        motor = add_passive_motor(spec, f"{place.joint}_hysteresis", mujoco.mjtTrn.mjTRN_JOINT, place.joint)
        motor.biasprm = np.array([0, 0, 0, torque, torque, 1.0, 0, 0, 0, 0])
        motor.dynprm = np.array([0, 0, 0, 0, 0, stiffness, 0, 0, 0, 0])
        motor.actdim = 1

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """What is turned over keeps the joint from its target as far as its torque bends the servo."""
        holds = scale.kp * seen.held_off
        return _of_torques(scale, (0.25 * holds, holds)) if holds > 0.0 else ()

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return _of_torques(scale, (0.005 * scale.kp, 0.03 * scale.kp))


def _of_torques(scale: Scale, torques: tuple[float, ...]) -> tuple[dict[str, float], ...]:
    return tuple({"torque": t, "stiffness": k * scale.kp} for t in torques for k in (0.05, 0.4))
