"""How the two joints of an underactuated finger share one tendon."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Story
from twin_daemon.effects.edits import add_joint_tendon, add_to_linear

_SLACK = 1e-8  # N m/rad: the weakest spring that can still hold a preload
_FAR = 10.0
_CLEAR = 1.0  # rad: so far off is the joint's own end, where another limit stands in for it


_PULL, _BEND = Reach("kp", 0.2), Reach("kp", 0.5)  # the ranges below are those of a servo of 10 N m/rad


class Coupling(Effect):
    """The tendon sets the sum; who moves first is decided by what resists at either joint.

    Springs and preload are fixed tendons, friction is `frictionloss`. The end of the proximal joint and the rest of
    the distal one move with the other joint: limits of fixed tendons with the joints' own softness, in place of the
    joints' own limits. The distal joint (J1) is the one whose body hangs on the other's.
    """

    key = "coupling"
    title = "the split of one tendon between two joints"
    acts_on = "tendon"
    rank = 200
    parameters = (
        Parameter("preload", "N m", -2.0, 2.0, 0.0, 0.5, "torque that holds the distal joint open", reach=_PULL),
        Parameter("spring_distal", "N m/rad", 0.0, 5.0, 0.0, 0.035, "spring that opens the distal joint", reach=_BEND),
        Parameter(
            "spring_proximal", "N m/rad", 0.0, 5.0, 0.0, 0.055, "spring that opens the proximal joint", reach=_BEND
        ),
        Parameter(
            "friction_distal",
            "N m",
            0.0,
            2.0,
            0.0,
            0.03,
            "dry friction of the distal joint beside the model's",
            reach=_PULL,
        ),
        Parameter("friction_tendon", "N m", 0.0, 2.0, 0.0, 0.08, "dry friction along the tendon", reach=_PULL),
        Parameter("stop", "rad", -0.5, 0.5, 0.0, 0.05, "how much later than in the model the proximal joint ends"),
        Parameter("stop_slope", "1", -0.5, 0.5, 0.0, 0.03, "how far that end moves by radian of the distal joint"),
        Parameter("rest_slope", "1", 0.0, 0.5, 0.0, 0.025, "how far the proximal joint takes the distal one along"),
    )
    story = Story(
        what="One motor pulls one tendon across two joints, and springs, friction and stops decide which one moves.",
        shows="Closing, the proximal joint goes first; opening, the distal one; their sum follows the command.",
        cause="The design of the finger; wear and pretension change the figures.",
        remedy="None is due; a changed split points to the finger's return springs and tendon.",
        excitation="closing and opening fully and half way, at two speeds, with reversals on the way back",
    )
    confusable = ("spring", "coulomb_friction", "joint_stop")
    contains = ("spring", "coulomb_friction")

    def applies(self, place: Place) -> bool:
        return super().applies(place) and len(place.driven) == 2

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        proximal, distal = proximal_and_distal(spec, place)
        stiffness = values["spring_distal"] + _SLACK
        rest = -values["preload"] / stiffness
        add_joint_tendon(spec, f"{distal}_return", {distal: 1.0}, stiffness=stiffness, rest=(rest, rest))
        add_joint_tendon(
            spec, f"{proximal}_return", {proximal: 1.0}, stiffness=values["spring_proximal"], rest=(0.0, 0.0)
        )
        add_to_linear(spec.joint(distal), "frictionloss", values["friction_distal"], place)
        add_to_linear(spec.tendon(place.tendon), "frictionloss", values["friction_tendon"], place)
        end, rest = spec.joint(proximal), spec.joint(distal)
        last, first = float(end.range[1]), float(rest.range[0])
        if end.range[0] < end.range[1]:
            moved = {proximal: 1.0, distal: -values["stop_slope"]}
            _limit(spec, f"{proximal}_end", moved, (-_FAR, last + values["stop"]), end)
            end.range = np.array([end.range[0], last + _CLEAR])
        if rest.range[0] < rest.range[1]:
            _limit(spec, f"{distal}_rest", {distal: 1.0, proximal: -values["rest_slope"]}, (first, _FAR), rest)
            rest.range = np.array([first - _CLEAR, rest.range[1]])

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        unit = scale.kp / 10.0
        calm = self.neutral()
        springs = {"preload": 0.12 * unit, "spring_distal": 0.035 * unit, "spring_proximal": 0.055 * unit}
        friction = {"friction_distal": 0.03 * unit, "friction_tendon": 0.08 * unit}
        stops = {"stop": 0.06, "stop_slope": 0.03, "rest_slope": 0.025}
        return (
            {**calm, **springs},
            {**calm, **springs, **friction},
            {**calm, **springs, **friction, "preload": 0.5 * unit, **stops},
            {**calm, "preload": 0.4 * unit},
            {**calm, "preload": -0.12 * unit, "spring_proximal": 0.05 * unit},
        )


def _limit(spec: Any, name: str, joints: Mapping[str, float], limits: tuple[float, float], like: Any) -> None:
    """A limit on a sum of joints that gives way as a joint's own does."""
    tendon = add_joint_tendon(spec, name, joints, rest=(-_FAR, _FAR))
    tendon.limited = mujoco.mjtLimited.mjLIMITED_TRUE
    tendon.range = np.array(limits)
    tendon.solref_limit, tendon.solimp_limit, tendon.margin = like.solref_limit, like.solimp_limit, like.margin


def proximal_and_distal(spec: Any, place: Place) -> tuple[str, str]:
    """(proximal, distal) MJCF joint of an actuator that drives two: the distal one's body hangs on the other's."""
    first, second = place.driven
    body = spec.joint(first).parent
    above = set()
    while body is not None:
        above.add(body.name)
        body = body.parent
    return (second, first) if spec.joint(second).parent.name in above else (first, second)
