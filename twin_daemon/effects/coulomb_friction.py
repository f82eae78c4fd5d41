"""Coulomb friction: a torque against the motion, of one size at every speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story
from twin_daemon.effects.edits import add_to_linear


class CoulombFriction(Effect):
    """Dry friction as `frictionloss`, a constraint with true sticking (MuJoCo manual, joint frictionloss)."""

    key = "coulomb_friction"
    title = "more (or less) dry friction"
    acts_on = "joint"
    parameters = (
        Parameter("friction", "N m", -5.0, 5.0, 0.0, 0.05, "dry friction beside the model's own; below 0 it has less"),
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
        add_to_linear(spec.joint(place.joint), "frictionloss", values["friction"], place)

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        own, strong = scale.frictionloss, 0.01 * scale.kp
        return ({"friction": 0.5 * strong}, {"friction": 2.0 * strong}, {"friction": -0.7 * own})
