"""Coulomb friction: a torque against the motion, of one size at every speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_passive_motor, add_to_linear, bristle_stiffness, linear

_FLOOR = 1e-9  # N m: the law divides by its torque


class CoulombFriction(Effect):
    """Dry friction of one size: a stiff bristle (Dahl 1968) that holds at rest, or MuJoCo's own `frictionloss`.

    `frictionloss` is a soft constraint: under a load below its limit it creeps, with the model's default softness
    within a few tenths of a second back to where the servo wants it. Real dry friction stays. Less friction than the
    model has can only be taken from its `frictionloss`.
    """

    key = "coulomb_friction"
    title = "more (or less) dry friction"
    acts_on = "joint"
    rank = 40
    stands_for = "frictionloss"
    as_nominal: ClassVar[Mapping[str, float]] = {"sticking": 0.0}
    dissipative = True
    shared = "joints"
    everywhere = "share"
    parameters = (
        Parameter(
            "friction",
            "N m",
            -5.0,
            5.0,
            0.0,
            0.05,
            "dry friction beside the model's own; below 0 it has less",
            reach=Reach("kp", 0.5),
        ),
        Parameter("sticking", "1", 0.0, 1.0, 1.0, 1.0, "part of it that holds for ever; the rest creeps at rest"),
        Parameter("share", "1", -0.95, 1000.0, 0.0, 0.0, "more of each joint's own friction; of the robot as a whole"),
    )
    story = Story(
        what="A torque against the motion that does not depend on speed; at rest it holds.",
        shows="The joint stops short of its target on the side it came from, and stays behind at reversals.",
        cause="Worn or dry bearings, a tendon that rubs, a shaft seal, a joint that is screwed too tight.",
        remedy="Clean and grease the joint, check bearing and preload.",
        excitation="slow small reversals, and holds reached from both sides",
    )
    confusable = ("stribeck_friction", "load_friction", "hysteresis", "backlash", "viscous_friction")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        friction = values["friction"] + values["share"] * linear(spec.joint(place.joint), "frictionloss")
        holds = values["sticking"] * max(friction, 0.0)
        add_to_linear(spec.joint(place.joint), "frictionloss", friction - holds, place)
        # always there, so that all values share one layout of the model
        stiffness = bristle_stiffness(spec, place)
        motor = add_passive_motor(spec, f"{place.joint}_coulomb", mujoco.mjtTrn.mjTRN_JOINT, place.joint)
        motor.biasprm = np.array([0, 0, 0, holds + _FLOOR, holds + _FLOOR, 1.0, 0, 0, 0, 0])
        motor.dynprm = np.array([0, 0, 0, 0, 0, stiffness, 0, 0, 0, 0])
        motor.actdim = 1

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """At rest it keeps the joint as far from its target as it bends the servo: up to the friction over kp."""
        holds = scale.kp * seen.held_off
        return _of_strengths(scale, *(share * holds for share in (0.1, 0.4, 1.0))) if holds > 0.0 else ()

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return _of_strengths(scale, *(share * scale.kp for share in (0.005, 0.02, 0.05)))

    def starts_everywhere(self) -> tuple[dict[str, float], ...]:
        more = tuple({"friction": 0.0, "sticking": sticks, "share": 5.0} for sticks in (1.0, 0.0))
        return (*more, {"friction": 0.0, "sticking": 0.0, "share": -0.7})


def _of_strengths(scale: Scale, *strengths: float) -> tuple[dict[str, float], ...]:
    own, middle = scale.frictionloss, strengths[len(strengths) // 2]
    more = tuple({"friction": strength, "sticking": 1.0} for strength in strengths)
    return (*more, {"friction": 0.5 * middle, "sticking": 0.0}, {"friction": -0.7 * own, "sticking": 0.0})
