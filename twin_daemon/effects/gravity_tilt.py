"""The hand is not mounted as the model says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story


class GravityTilt(Effect):
    """Gravity turned about x and then about y of the world: what the hand feels when its base is tilted."""

    key = "gravity_tilt"
    title = "the hand stands tilted"
    acts_on = "hand"
    rank = 120
    shared = "load"
    parameters = (
        Parameter("about_x", "rad", -np.pi, np.pi, 0.0, 0.4, "gravity turned about the world's x"),
        Parameter("about_y", "rad", -np.pi, np.pi, 0.0, 0.4, "gravity turned about the world's y"),
    )
    story = Story(
        what="Gravity points elsewhere than the model believes.",
        shows="All joints sag together, each as its link lies; errors at rest that follow the pose.",
        cause="Another mounting angle, an arm that carries the hand in another pose.",
        remedy="Measure how the hand is mounted and enter it.",
        excitation="holds of several joints at several angles",
    )
    confusable = ("payload", "spring")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        (cx, sx), (cy, sy) = [(np.cos(values[n]), np.sin(values[n])) for n in ("about_x", "about_y")]
        about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
        about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
        spec.option.gravity = about_y @ about_x @ np.asarray(spec.option.gravity, float)

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return (
            {"about_x": 0.5, "about_y": 0.0},
            {"about_x": -0.5, "about_y": 0.0},
            {"about_x": 0.0, "about_y": 0.5},
            {"about_x": 0.0, "about_y": -0.5},
            {"about_x": 1.5, "about_y": 0.0},
            {"about_x": -1.5, "about_y": 0.0},
        )
