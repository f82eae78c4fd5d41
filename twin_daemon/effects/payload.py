"""A load on a link, on its line to the next one or beside that: something held, a glove, a sensor that was added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Story

_TINY = 1e-9  # kg: a body without mass would be another structure
_GYRATION_M = 0.005  # the load's own radius of gyration
_LENGTH = Reach("length", 1.0)


def _square_to(line: np.ndarray) -> np.ndarray:
    """(2, 3) two directions square to a line (3,) and to each other, right-handed with it.

    The first is as near as it can be to the axis of the frame that the line is the least along.
    """
    length = float(np.linalg.norm(line))
    along = line / length if length > 0.0 else np.array([0.0, 0.0, 1.0])
    nearest = np.eye(3)[int(np.argmin(np.abs(along)))]
    first = nearest - (nearest @ along) * along
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(along, first)])


class Payload(Effect):
    """A point mass on the joint's link: on the line to where its next link begins or, on the last link, to its end.

    Most loads are near that line. How far one is beside it (`across_1`, `across_2`, see `_square_to`) is asked of the
    data only where a load on the line leaves more than it should.
    """

    key = "payload"
    title = "a load on the link"
    acts_on = "joint"
    rank = 60
    shared = "load"
    parameters = (
        Parameter("mass", "kg", 0.0, 5.0, 0.0, 0.05, "mass on the joint's link", reach=Reach("kp", 0.5)),
        Parameter("at", "1", 0.0, 1.5, 1.0, 1.0, "where on the link: 0 at the joint, 1 at its far end", held=True),
        Parameter(
            "across_1", "m", -0.05, 0.05, 0.0, 0.0, "how far beside the link's line", refines=True, reach=_LENGTH
        ),
        Parameter("across_2", "m", -0.05, 0.05, 0.0, 0.0, "and square to that", refines=True, reach=_LENGTH),
    )
    story = Story(
        what="Mass that the model does not have: it weighs and it resists acceleration.",
        shows="The joint and those below it sag with gravity, and overshoot when they stop.",
        cause="An object in the hand, a glove, a tactile sensor, a tool.",
        remedy="Enter the load in the model, or take it off.",
        excitation="holds at angles where gravity pulls differently, and steps",
    )
    confusable = ("spring", "gravity_tilt", "armature", "actuator_gain")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        mass = values["mass"] + _TINY
        carrier = spec.body(place.end_body)
        line = np.array(place.end)
        at = values["at"] * line + np.array([values["across_1"], values["across_2"]]) @ _square_to(line)
        load = carrier.add_body(name=f"{place.joint}_payload", pos=at)
        load.explicitinertial = True
        load.mass = mass
        load.ipos = np.zeros(3)  # not the default, which MuJoCo takes for "unknown" and would not save
        load.inertia = np.full(3, mass * _GYRATION_M**2)

    def acts_at(self, place: Place) -> str:
        # a knuckle that is one point, and each joint of a link that turns about several, carry the same load
        return place.end_body or place.target

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        # bends the joint by 10 and by 50 mrad at an arm of 5 cm, within what such hands carry
        return tuple({"at": 1.0, "mass": min(sag * scale.kp / (9.81 * 0.05), 50.0)} for sag in (0.01, 0.05))
