"""What a missing law may depend on, and where it may act: the ports and variables that compete.

A law is a sum over a basis. Over one variable the basis are hats, so that its coefficients are the curve itself at its
knots; a memory is a row of elements with different lengths (widths of play, times of relaxation), and its
coefficients say how strong each is. A curve may be multiplied by the joint's direction or velocity, or by the servo's
error.

With the direction it is a law of dry friction: a level that holds a joint where it stands, as the solver's own friction
does; a torque that depends on the speed alone lets it creep. Over the speed, it has a level at each speed either way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from twin_daemon.proposals.thresholds import (
    BENDS,
    COMMAND_KNOTS,
    FEW_BENDS,
    FEW_POSITIONS,
    FINE_POSITIONS,
    FRICTION_BENDS,
    HEAT_KNOTS,
    LAGS_S,
    LARGEST_FACTOR,
    LARGEST_RAD,
    LARGEST_RELAXING,
    LOAD_BENDS,
    NEIGHBOUR_KNOTS,
    ORIENTATION_KNOTS,
    PLAY_RAD,
    POSITION_KNOTS,
    RATES,
    TIME_KNOTS,
    TIMES_S,
)

Port = Literal["torque", "command", "reading"]
Factor = Literal["", "direction", "error", "velocity"]
Memory = Literal["", "play", "relaxation", "creep", "lag", "slew"]

OF_NEIGHBOURS = ("neighbour", "neighbour_velocity")


@dataclass(frozen=True)
class Feature:
    """One port and what a law there depends on.

    `over` is the variable of the curve: position (rad), velocity (rad/s), acceleration (rad/s2), load (N m, the size of
    what the servo gives), orientation (rad, of gravity in the link), time (s), heat (1), command (rad) and its rate,
    error (rad), or the angle (rad) or the velocity (rad/s) of the joint `neighbour`. `knots` (k,) are in its unit; with
    a `memory` they are the lengths of its elements, in rad or s, or their rates in rad/s. `unit` is that of the
    coefficients, `most` the largest that is looked for.
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
        own = self.over
        if own in OF_NEIGHBOURS:
            own = self.neighbour if own == "neighbour" else f"{self.neighbour} velocity"
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
    kp: float, seen: Mapping[str, np.ndarray], neighbours: Mapping[tuple[str, str], np.ndarray]
) -> list[Feature]:
    """Every port and variable that these data can say something about, of the same ones those with fewer knots first.

    `seen` has what was measured along the motion, each (n,): position, velocity, acceleration, error, command, heat and
    time; `neighbours` each one's angle and velocity, by its name and which of OF_NEIGHBOURS. `kp` in N m/rad is the
    servo's stiffness. Knots cover what was visited, nothing beyond it.
    """
    at = {
        "position": _even(seen["position"], POSITION_KNOTS),
        "few_positions": _even(seen["position"], FEW_POSITIONS),
        "velocity": _by_size(seen["velocity"], BENDS),
        "friction": tuple(k for k in _by_size(seen["velocity"], FRICTION_BENDS) if k),
        "acceleration": _by_size(seen["acceleration"], FEW_BENDS),
        "load": tuple(knot for knot in _by_size(kp * seen["error"], LOAD_BENDS) if knot >= 0.0),
        "orientation": _even(seen["orientation"], ORIENTATION_KNOTS),
        "time": tuple(np.linspace(0.0, float(seen["time"].max()), TIME_KNOTS)),
        "heat": _even(seen["heat"], HEAT_KNOTS),
        "command": _even(seen["command"], COMMAND_KNOTS),
        "error": _by_size(seen["error"], BENDS),
        # a joint behind a command of limited rate moves about as fast as that, and overshoots a little
        "rates": tuple(share * float(np.abs(seen["velocity"]).max()) for share in RATES),
    }
    strong, far, factor = LARGEST_RAD * kp, LARGEST_RAD, LARGEST_FACTOR
    positions = (_straight(at["position"]), at["position"], _even(seen["position"], FINE_POSITIONS))
    damping = strong / max(float(np.abs(seen["velocity"]).max()), 1e-9)
    found = [
        *(Feature("torque", "position", knots, "N m", strong) for knots in positions),
        *(Feature("torque", "velocity", knots, "N m", strong) for knots in (_straight(at["velocity"]), at["velocity"])),
        *(
            Feature("torque", "velocity", knots, "N m", strong, factor="direction")
            for knots in (_straight(at["friction"]), at["friction"])
        ),
        Feature("torque", "load", at["load"], "N m", strong, factor="direction"),
        *(
            Feature("torque", "acceleration", knots, "N m", strong)
            for knots in (_straight(at["acceleration"]), at["acceleration"])
        ),
        Feature("torque", "orientation", at["orientation"], "N m", strong),
        Feature("torque", "time", at["time"], "N m", strong),
        Feature("torque", "position", at["few_positions"], "N m", strong, factor="direction"),
        Feature("torque", "position", at["few_positions"], "N m s/rad", damping, factor="velocity"),
        Feature("torque", "time", at["time"], "N m s/rad", damping, factor="velocity"),
        Feature("torque", "time", at["time"], "N m", strong, factor="direction"),
        Feature("torque", "velocity", PLAY_RAD, "N m", strong, memory="play"),
        Feature("torque", "velocity", TIMES_S, "N m/rad", LARGEST_RELAXING * kp, memory="relaxation"),
        *(Feature("command", "error", knots, "rad", far) for knots in (_straight(at["error"]), at["error"])),
        Feature("command", "time", at["time"], "1", factor, factor="error"),
        Feature("command", "heat", at["heat"], "1", factor, factor="error"),
        Feature("command", "position", at["few_positions"], "1", factor, factor="error"),
        *(Feature("command", "command", knots, "rad", far) for knots in (_straight(at["command"]), at["command"])),
        Feature("command", "command_rate", LAGS_S, "1", factor, memory="lag"),
        Feature("command", "command_rate", at["rates"], "1", factor, memory="slew"),
        Feature("command", "error", TIMES_S, "1", factor, memory="creep"),
        *(Feature("reading", "position", knots, "rad", far) for knots in positions),
        Feature("reading", "time", at["time"], "rad", far),
    ]
    for (name, over), series in neighbours.items():
        if over == "neighbour_velocity":
            found.append(Feature("torque", over, _by_size(series, FEW_BENDS), "N m", strong, neighbour=name))
            continue
        knots = _even(series, NEIGHBOUR_KNOTS)
        found += [
            Feature("reading", over, knots, "rad", far, neighbour=name),
            Feature("torque", over, knots, "N m", strong, neighbour=name),
            Feature("torque", over, knots, "N m", strong, factor="direction", neighbour=name),
        ]
    return [one for one in found if one.memory or one.knots[-1] - one.knots[0] > 1e-6]


def _even(values: np.ndarray, count: int) -> tuple[float, ...]:
    low, high = np.percentile(values, [0.05, 99.95])
    return tuple(np.linspace(low, high, count))


def _straight(knots: Sequence[float]) -> tuple[float, float]:
    """Two knots, between which there are constants and lines alone."""
    return knots[0], knots[-1]


def _by_size(values: np.ndarray, bends: Sequence[float]) -> tuple[float, ...]:
    """Knots that are dense about 0, where laws of speeds and errors bend, and reach the largest of either sign.

    The few samples of a step are its fastest: a drag that were flat there would be made up for by damping.
    """
    far = float(np.abs(values).max(initial=0.0)) or 1.0
    half = [far * share for share in bends]
    return (*(-x for x in reversed(half)), 0.0, *half)
