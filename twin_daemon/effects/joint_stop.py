"""The joint meets something before its end of travel."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_joint_tendon

_EDGES = (0.05, 0.005)  # of the samples from either end: a joint that stands at a stop does so for at least that share
_STIFF = 4.0  # times the servo's stiffness
_RANGE = Reach("span", 1.0)
_RARE = np.array([0.005, 0.01, 0.02, 0.03])
# quantiles of the angle at which a stop may begin: one that only the widest motion meets is met in few samples
_BEGINNINGS = np.concatenate([_RARE, np.arange(0.05, 1.0, 0.05), 1.0 - _RARE[::-1]])


def _end(name: str, default: float, meaning: str) -> Parameter:
    return Parameter(name, "rad", -0.5, 3.0, 0.0, default, meaning, reach=_RANGE, place=True)


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
        _end("upper", 0.8, "where it begins, this much before the upper end"),
        _end("lower", 0.0, "where it begins, this much after the lower end"),
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
        span, k = scale.span, 2.0 * scale.kp
        return (
            {"stiffness": k, "upper": 0.2 * span, "lower": 0.0},
            {"stiffness": k, "upper": 0.5 * span, "lower": 0.0},
            {"stiffness": k, "upper": 0.0, "lower": 0.2 * span},
            {"stiffness": 0.2 * k, "upper": 0.4 * span, "lower": 0.0},
        )

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """Where the error begins to grow, at either end or both: at rest a stop bends the servo by stiffness over kp.

        A stiff stop is hardly entered, so that the joint stands at its edge: at either end of what is seen of the angle
        one such is suggested as well.
        """
        angle, gap = seen.angle, seen.gap
        begins = np.quantile(angle, _BEGINNINGS)
        above = np.maximum(angle - begins[:, None], 0.0)  # (b, n) rad beyond a beginning, towards the upper end
        below = np.maximum(begins[:, None] - angle, 0.0)
        pushed = np.array([-above @ gap, below @ gap])  # (2, b)
        power = np.array([(above**2).sum(axis=1), (below**2).sum(axis=1)])
        where = {"upper": scale.upper - begins, "lower": begins - scale.lower}
        apart = begins[:, None] > begins
        # at one end, at the other, and at both: from one end alone where the other begins has no slope
        sides = {
            ("upper",): (pushed[0], power[0]),
            ("lower",): (pushed[1], power[1]),
            ("upper", "lower"): (
                np.where(apart, np.add.outer(pushed[0], pushed[1]), 0.0),
                np.add.outer(power[0], power[1]),
            ),
        }
        found: list[tuple[float, dict[str, float]]] = []
        for ends, (push, entered) in sides.items():
            taken = np.divide(push**2, entered, out=np.zeros_like(entered), where=(entered > 0.0) & (push > 0.0))
            at = np.unravel_index(np.argmax(taken), taken.shape)
            if taken[at] > 0.0:
                values = {"stiffness": float(push[at] / entered[at]) * scale.kp, "upper": 0.0, "lower": 0.0}
                values |= {end: float(where[end][index]) for end, index in zip(ends, at, strict=True)}
                found.append((float(taken[at]), values))
        found.sort(key=lambda one: -one[0])
        stands = {"stiffness": _STIFF * scale.kp, "upper": 0.0, "lower": 0.0}
        edges: list[dict[str, float]] = []
        for share in _EDGES:
            low, high = np.quantile(angle, (share, 1.0 - share))
            edges.append(stands | {"upper": scale.upper - float(high)})
            edges.append(stands | {"lower": float(low) - scale.lower})
        return (*(values for _, values in found), *edges)
