"""What a missing law may depend on, and where it may act: the ports and variables that compete.

A law is a sum over a basis. Over one variable the basis are hats, so that its coefficients are the curve itself at its
knots; a memory is a row of elements with different lengths (widths of play, times of relaxation), and its
coefficients say how strong each is. A curve may be multiplied by the joint's direction or by the servo's error.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin_daemon.proposals.thresholds import (
    COMMAND_KNOTS,
    FEW_POSITIONS,
    HEAT_KNOTS,
    LARGEST_FACTOR,
    LARGEST_RAD,
    LARGEST_RELAXING,
    NEIGHBOUR_KNOTS,
    PLAY_RAD,
    POSITION_KNOTS,
    TIME_KNOTS,
    TIMES_S,
)

Port = Literal["torque", "command", "reading"]
Factor = Literal["", "direction", "error"]
Memory = Literal["", "play", "relaxation", "creep"]


@dataclass(frozen=True)
class Feature:
    """One port and what a law there depends on.

    `over` is the variable of the curve: position (rad), velocity (rad/s), time (s), heat (1), command (rad), error
    (rad), or neighbour (rad) of the joint `neighbour`. `knots` (k,) are in its unit; with a `memory` they are the
    lengths of its elements, in rad or s. `unit` is that of the coefficients, `most` the largest that is looked for.
    """

    port: Port
    over: str
    knots: tuple[float, ...]
    unit: str
    most: float
    factor: Factor = ""
    memory: Memory = ""
    neighbour: str = ""

    @property
    def variables(self) -> tuple[str, ...]:
        """What the law depends on, in the words of the report."""
        own = self.neighbour or self.over
        return (own, self.factor) if self.factor else (own,)

    @property
    def name(self) -> str:
        memory = f"{self.memory} of " if self.memory else ""
        return f"{self.port}: {memory}{' x '.join(self.variables)}"

    def curve(self, coefficients: np.ndarray, x: np.ndarray) -> np.ndarray:
        """The curve with coefficients (B, k) at (B, ...) values of its variable; flat beyond its knots."""
        knots = np.array(self.knots)
        place = np.clip(np.interp(x, knots, np.arange(len(knots))), 0.0, len(knots) - 1.0)
        index = np.minimum(place.astype(int), len(knots) - 2)
        share = place - index
        rows = np.arange(len(x)).reshape(-1, *[1] * (x.ndim - 1))
        return coefficients[rows, index] * (1.0 - share) + coefficients[rows, index + 1] * share


def features(
    kp: float,
    position: np.ndarray,
    velocity: np.ndarray,
    error: np.ndarray,
    command: np.ndarray,
    seconds: float,
    heat: np.ndarray,
    neighbours: dict[str, np.ndarray],
) -> list[Feature]:
    """Every port and variable that these data can say something about.

    `position`, `velocity`, `error`, `command`, `heat` (n,) are as measured along the motion, each neighbour's angles as
    well; `kp` in N m/rad is the servo's stiffness. Knots cover what was visited, nothing beyond it.
    """
    at = {
        "position": _even(position, POSITION_KNOTS),
        "few_positions": _even(position, FEW_POSITIONS),
        "velocity": _by_size(velocity),
        "time": tuple(np.linspace(0.0, seconds, TIME_KNOTS)),
        "heat": _even(heat, HEAT_KNOTS),
        "command": _even(command, COMMAND_KNOTS),
        "error": _by_size(error),
    }
    strong, far, factor = LARGEST_RAD * kp, LARGEST_RAD, LARGEST_FACTOR
    found = [
        Feature("torque", "position", at["position"], "N m", strong),
        Feature("torque", "velocity", at["velocity"], "N m", strong),
        Feature("torque", "time", at["time"], "N m", strong),
        Feature("torque", "position", at["few_positions"], "N m", strong, factor="direction"),
        Feature("torque", "velocity", PLAY_RAD, "N m", strong, memory="play"),
        Feature("torque", "velocity", TIMES_S, "N m/rad", LARGEST_RELAXING * kp, memory="relaxation"),
        Feature("command", "error", at["error"], "rad", far),
        Feature("command", "time", at["time"], "1", factor, factor="error"),
        Feature("command", "heat", at["heat"], "1", factor, factor="error"),
        Feature("command", "position", at["few_positions"], "1", factor, factor="error"),
        Feature("command", "command", at["command"], "rad", far),
        Feature("command", "error", TIMES_S, "1", factor, memory="creep"),
        Feature("reading", "position", at["position"], "rad", far),
        Feature("reading", "time", at["time"], "rad", far),
    ]
    for name, angle in neighbours.items():
        knots = _even(angle, NEIGHBOUR_KNOTS)
        found += [
            Feature("reading", "neighbour", knots, "rad", far, neighbour=name),
            Feature("torque", "neighbour", knots, "N m", strong, neighbour=name),
            Feature("torque", "neighbour", knots, "N m", strong, factor="direction", neighbour=name),
        ]
    return [one for one in found if one.memory or one.knots[-1] - one.knots[0] > 1e-6]


def _even(values: np.ndarray, count: int) -> tuple[float, ...]:
    low, high = np.percentile(values, [0.5, 99.5])
    return tuple(np.linspace(low, high, count))


def _by_size(values: np.ndarray) -> tuple[float, ...]:
    """Knots that are dense about 0, where laws of speeds and errors bend, and reach the largest of either sign.

    The few samples of a step are its fastest: a drag that were flat there would be made up for by damping.
    """
    far = float(np.abs(values).max(initial=0.0)) or 1.0
    half = [far * share for share in (0.02, 0.07, 0.2, 0.5, 1.0)]
    return (*(-x for x in reversed(half)), 0.0, *half)
