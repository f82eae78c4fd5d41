"""Rotor inertia, as the joint feels it through the gear."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Story
from twin_daemon.effects.edits import add_to_linear


class Armature(Effect):
    """Inertia times gear ratio squared, as `armature` (MuJoCo manual, joint armature)."""

    key = "armature"
    title = "more (or less) inertia of the motor"
    acts_on = "joint"
    rank = 50
    stands_for = "armature"
    parameters = (
        Parameter(
            "armature",
            "kg m2",
            -1.0,
            1.0,
            0.0,
            0.002,
            "inertia beside the model's own; below 0 it has less",
            reach=Reach("inertia", 100.0),
        ),
    )
    story = Story(
        what="Inertia of the rotor and the gear, which turn faster than the joint.",
        shows="Overshoot after steps and fast stops; nothing in slow motion or at rest.",
        cause="Another motor or gear ratio than the model has; a heavy pulley.",
        remedy="Enter the motor's data; no repair is due.",
        excitation="steps and fast reversals",
    )
    confusable = ("payload", "viscous_friction", "actuator_gain", "actuator_lag")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        add_to_linear(spec.joint(place.joint), "armature", values["armature"], place)

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        more = tuple({"armature": factor * scale.inertia} for factor in (0.5, 3.0, 10.0))
        return (*more, {"armature": -0.5 * scale.armature}) if scale.armature > 0.0 else more
