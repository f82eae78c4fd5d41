"""Viscous friction: a torque against the motion, proportional to speed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_to_linear, linear


class ViscousFriction(Effect):
    """Torque -b v beside what the model has (MuJoCo manual, joint damping)."""

    key = "viscous_friction"
    title = "more (or less) viscous friction"
    acts_on = "joint"
    rank = 30
    stands_for = "damping"
    dissipative = True
    shared = "joints"
    everywhere = "share"
    reads_nominal_error = True
    parameters = (
        Parameter(
            "damping",
            "N m s/rad",
            -20.0,
            20.0,
            0.0,
            0.1,
            "damping beside the model's own; below 0 it has less",
            reach=Reach("kp", 1.0),
        ),
        Parameter("share", "1", -0.95, 200.0, 0.0, 0.0, "more of each joint's own damping; of the robot as a whole"),
    )
    story = Story(
        what="A torque against the motion that grows with speed.",
        shows="A lag that is proportional to speed; nothing at rest.",
        cause="Grease that has thickened or dried, a tendon sheath that drags, cold.",
        remedy="Clean and grease the joint; check the tendon's sheath.",
        excitation="the same motion at two clearly different speeds",
    )
    confusable = ("coulomb_friction", "actuator_lag", "command_delay", "actuator_gain")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        joint = spec.joint(place.joint)
        add_to_linear(joint, "damping", values["damping"] + values["share"] * linear(joint, "damping"), place)

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The damping that makes the servo late by as much as the motion is, beside the usual ones."""
        late = ({"damping": seen.late_s * scale.kp},) if seen.late_s > 0.0 else ()
        return (*late, *self.starts(scale))

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        # a servo's own derivative gain damps as well: what adds little to both does not show
        damped = scale.damping + scale.kv
        more = dict.fromkeys((0.5 * scale.damping, 0.5 * damped, 2.0 * damped))
        return (*({"damping": value} for value in more), {"damping": -0.5 * scale.damping})

    def starts_everywhere(self) -> tuple[dict[str, float], ...]:
        return ({"damping": 0.0, "share": 3.0}, {"damping": 0.0, "share": -0.7})
