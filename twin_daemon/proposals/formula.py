"""A formula for a curve: simple laws of one variable, of which the one with the shortest description is taken.

Each family is a few values with a meaning. It is fitted to the curve's knots with their uncertainty, one roll-out each
says which are worth more, and the values of these are fitted again in roll-outs, which is what gives their intervals.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from twin_daemon.proposals.features import Feature
from twin_daemon.proposals.thresholds import (
    BEYOND,
    CURVE_BLUR,
    DENSE_KNOTS,
    FASTER,
    STOP_DEPTHS,
    STOP_STIFFNESSES,
)

Shape = Callable[[np.ndarray, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Family:
    """A law of one variable x: the names of its values, what it says, and where a fit of a curve may begin.

    `sharp` has starts for what a curve's knots cannot show, from x (k,) and the servo's stiffness in N m/rad.
    """

    key: str
    words: str
    names: tuple[str, ...]
    shape: Shape
    starts: Callable[[np.ndarray, np.ndarray], list[list[float]]]
    sharp: Callable[[np.ndarray, float], list[list[float]]] = lambda x, kp: []


@dataclass(frozen=True)
class Formula:
    """A family with its values (q,)."""

    family: Family
    values: np.ndarray

    def in_order(self) -> Formula:
        """The same law with positive sizes and widths, and a phase within half a turn."""
        values = self.values.copy()
        if self.family.key == "sine":
            for index, partner in ((1, 2), (0, None)):
                if values[index] >= 0.0:
                    continue
                values[index] = -values[index]
                if partner is not None:  # sin(-n x + p) = sin(n x + (pi - p))
                    values[partner] = np.pi - values[partner]
                else:
                    values[2] += np.pi
            values[2] = float(np.angle(np.exp(1j * values[2])))
        elif self.family.key in ("bump", "notch") and values[2] < 0.0:
            values[2] = -values[2]
            values[0] *= -1.0 if self.family.key == "notch" else 1.0
        elif self.family.key == "stribeck":
            values[1] = abs(values[1])
        return replace(self, values=values)

    def text(self, variable: str) -> str:
        """The formula with its values, such as `0.05 sin(9 q + 0.7)`."""
        named = dict(zip(self.family.names, (f"{v:.3g}" for v in self.values), strict=True))
        return self.family.words.format(x=variable, **named).replace("+ -", "- ")


def _line(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] + p[1] * x


def _constant(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.full_like(x, p[0])


def _cubic(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] + p[1] * x + p[2] * x**3


def _above(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return -p[0] * np.maximum(x - p[1], 0.0)


def _below(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * np.maximum(p[1] - x, 0.0)


def _both(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * (np.maximum(p[1] - x, 0.0) - np.maximum(x - p[2], 0.0))


def _sine(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * np.sin(p[1] * x + p[2]) + p[3]


def _bump(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * np.exp(-(((x - p[1]) / _away_from_zero(p[2])) ** 2)) + p[3]


def _notch(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    u = (x - p[1]) / _away_from_zero(p[2])
    return -p[0] * u * np.exp(0.5 - 0.5 * u**2) + p[3]


def _settling(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * (1.0 - np.exp(-np.maximum(x, 0.0) / abs(_away_from_zero(p[1])))) + p[2]


def _power(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * np.sign(x) * np.abs(x) ** np.clip(p[1], 0.1, 5.0)


def _drag(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * x + p[1] * x * np.abs(x)


def _sides(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.where(x > 0.0, p[0], p[1]) * x


def _levels(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    steep = np.tanh(x / 0.03)
    return np.where(x > 0.0, p[0], p[1]) * np.abs(steep)


def _rubbing(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return _levels(p, x) + p[2] * x


def _stribeck(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] * np.exp(-((x / _away_from_zero(p[1])) ** 2)) + p[2]


def _dry(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return p[0] + p[1] * np.abs(x)


def _two_levels(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    # straight through rest over a thousandth of the range: at rest the direction says how much of it is left
    return np.interp(x, [-1e-3 * float(np.abs(x).max()), 1e-3 * float(np.abs(x).max())], [p[1], p[0]])


def _dead_zone(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return -np.clip(x, -abs(p[0]), abs(p[0]))


def _silent(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    half = abs(_away_from_zero(p[0]))
    # over a fiftieth of the zone, so that a fit finds a slope
    return -x / (1.0 + np.exp(np.clip((np.abs(x) - half) / (0.02 * half), -60.0, 60.0)))


def _saturating(p: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.clip(x, -abs(p[0]), abs(p[0])) - x


def _away_from_zero(value: float) -> float:
    value = float(value)
    return value if abs(value) > 1e-9 else 1e-9


def _combined(y: np.ndarray, *basis: np.ndarray) -> list[float]:
    """How much of each of some shapes (k,) a curve (k,) is, also where they are alike."""
    return list(np.linalg.lstsq(np.stack(basis, axis=1), y, rcond=None)[0])


def _sine_starts(x: np.ndarray, y: np.ndarray) -> list[list[float]]:
    span = float(np.ptp(x))
    found = []
    for waves in np.linspace(np.pi / span, 0.4 * np.pi * len(x) / span, 60):
        basis = np.stack([np.sin(waves * x), np.cos(waves * x), np.ones_like(x)], axis=1)
        (a, b, c), *_ = np.linalg.lstsq(basis, y, rcond=None)
        left = float(((basis @ [a, b, c] - y) ** 2).sum())
        found.append((left, [float(np.hypot(a, b)), float(waves), float(np.arctan2(b, a)), float(c)]))
    return [start for _, start in sorted(found)[:3]]


def _place_starts(x: np.ndarray, y: np.ndarray) -> list[list[float]]:
    middle, span = float(np.median(y)), float(np.ptp(x))
    peaks = {int(np.argmax(np.abs(y - middle))), int(np.argmax(np.abs(np.gradient(y, x))))}
    size = float(np.ptp(y))
    return [[s * size, float(x[i]), w * span, middle] for i in peaks for s in (-1.0, 1.0) for w in (0.05, 0.15)]


def _edge_starts(x: np.ndarray, y: np.ndarray, end: int) -> list[list[float]]:
    # from each of some edges to the end
    far = x[0] if end == 0 else x[-1]
    return [[abs(float(y[end] / (share * np.ptp(x)))), float(far + (share if end == 0 else -share) * np.ptp(x))]
            for share in (0.1, 0.25, 0.5)]  # fmt: skip


def _stops(ends: str) -> Callable[[np.ndarray, float], list[list[float]]]:
    def sharp(x: np.ndarray, kp: float) -> list[list[float]]:
        depths = [(low, high) for low in STOP_DEPTHS for high in STOP_DEPTHS if len(ends) > 1 or low == high]
        edges = [{"l": x[0] + low * np.ptp(x), "h": x[-1] - high * np.ptp(x)} for low, high in depths]
        return [[k * kp, *(float(edge[end]) for end in ends)] for k in STOP_STIFFNESSES for edge in edges]

    return sharp


FAMILIES = {
    "proportional": Family("proportional", "{slope} {x}", ("slope",), lambda p, x: p[0] * x,
                           lambda x, y: [[float(x @ y / max(x @ x, 1e-12))]]),
    "constant": Family("constant", "{constant}", ("constant",), _constant, lambda x, y: [[float(y.mean())]]),
    "line": Family("line", "{constant} + {slope} {x}", ("constant", "slope"), _line,
                   lambda x, y: [_combined(y, np.ones_like(x), x)]),
    "cubic": Family("cubic", "{constant} + {linear} {x} + {cubic} {x}^3", ("constant", "linear", "cubic"), _cubic,
                    lambda x, y: [_combined(y, np.ones_like(x), x, x**3)]),
    "above": Family("above", "-{stiffness} ({x} - {upper}) above {upper}", ("stiffness", "upper"), _above,
                    lambda x, y: _edge_starts(x, y, -1), _stops("h")),
    "below": Family("below", "{stiffness} ({lower} - {x}) below {lower}", ("stiffness", "lower"), _below,
                    lambda x, y: _edge_starts(x, y, 0), _stops("l")),
    "both": Family("both", "{stiffness} ({lower} - {x}) below {lower}, -{stiffness} ({x} - {upper}) above {upper}",
                   ("stiffness", "lower", "upper"), _both, lambda x, y: [], _stops("lh")),
    "sine": Family("sine", "{amplitude} sin({waves} {x} + {phase}) + {constant}",
                   ("amplitude", "waves", "phase", "constant"), _sine, _sine_starts),
    "bump": Family("bump", "{height} exp(-(({x} - {centre})/{width})^2) + {constant}",
                   ("height", "centre", "width", "constant"), _bump, _place_starts),
    "notch": Family("notch", "-{depth} u exp(0.5 - u^2/2) + {constant} with u = ({x} - {centre})/{width}",
                    ("depth", "centre", "width", "constant"), _notch, _place_starts),
    "settling": Family("settling", "{change} (1 - exp(-{x}/{time})) + {constant}", ("change", "time", "constant"),
                       _settling, lambda x, y: [[float(y[-1] - y[0]), t * float(np.ptp(x)), float(y[0])]
                                                for t in (0.1, 0.3, 1.0)]),
    "size": Family("size", "{constant} + {slope} |{x}|", ("constant", "slope"), _dry,
                   lambda x, y: [_combined(y, np.ones_like(x), np.abs(x))]),
    "weight": Family("weight", "{across} cos({x}) + {along} sin({x})", ("across", "along"),
                     lambda p, x: p[0] * np.cos(x) + p[1] * np.sin(x),
                     lambda x, y: [_combined(y, np.cos(x), np.sin(x))]),
    "power": Family("power", "{factor} sign({x}) |{x}|^{power}", ("factor", "power"), _power,
                    lambda x, y: [[float(x @ y / max(x @ x, 1e-12)), p] for p in (0.5, 1.0, 2.0)]),
    "drag": Family("drag", "{linear} {x} + {quadratic} {x} |{x}|", ("linear", "quadratic"), _drag,
                   lambda x, y: [_combined(y, x, x * np.abs(x))]),
    "rubbing": Family("rubbing", "{forward} forwards, {backward} backwards, + {slope} {x}",
                      ("forward", "backward", "slope"), _rubbing,
                      lambda x, y: [[float(y[x > 0].mean()), float(y[x < 0].mean()), 0.0]]),
    "sides": Family("sides", "{forward} {x} forwards, {backward} {x} backwards", ("forward", "backward"), _sides,
                    lambda x, y: [[0.1, -0.1], [-0.1, 0.1]]),
    "levels": Family("levels", "{forward} forwards, {backward} backwards", ("forward", "backward"), _levels,
                     lambda x, y: [[float(y[x > 0].mean()), float(y[x < 0].mean())]]),
    "dry": Family("dry", "{level} + {slope} |{x}|, against the motion", ("level", "slope"), _dry,
                  lambda x, y: [_combined(y, np.ones_like(x), np.abs(x))]),
    "two_levels": Family("two_levels", "{forward} forwards, {backward} backwards, against the motion",
                         ("forward", "backward"), _two_levels,
                         lambda x, y: [[float(y[x > 0].mean()), float(y[x < 0].mean())]]),
    "stribeck": Family("stribeck", "{breakaway} exp(-({x}/{velocity})^2) + {level}, against the motion",
                       ("breakaway", "velocity", "level"), _stribeck,
                       lambda x, y: [[float(np.ptp(y)), share * float(x[-1]), float(y[-1])]
                                     for share in (0.02, 0.07, 0.25)]),
    "dead_zone": Family("dead_zone", "-{x} up to {half}, constant beyond: a dead zone", ("half",), _dead_zone,
                        lambda x, y: [[0.1 * float(x[-1])], [0.3 * float(x[-1])]]),
    "silent": Family("silent", "-{x} up to {half}, nothing beyond: no torque for small errors", ("half",), _silent,
                     lambda x, y: [[s * float(x[-1])] for s in (0.05, 0.1, 0.2, 0.4)]),
    "saturating": Family("saturating", "nothing up to {most}, constant torque beyond", ("most",), _saturating,
                         lambda x, y: [[0.3 * float(x[-1])], [0.7 * float(x[-1])]]),
}  # fmt: skip

_OVER = {
    "position": ("constant", "line", "cubic", "above", "below", "both", "sine", "bump", "notch"),
    "neighbour": ("line", "size", "sine", "bump"),
    "command": ("line", "sine", "bump", "notch"),
    "orientation": ("weight", "line", "sine"),
    "time": ("line", "settling"),
    "heat": ("line", "settling"),
    "neighbour_velocity": ("proportional", "line", "power", "drag", "levels"),
    "acceleration": ("proportional", "line"),
    "load": ("line",),
    "velocity": ("proportional", "power", "drag", "sides", "levels", "rubbing"),
    "error": ("proportional", "power", "sides", "dead_zone", "silent", "saturating"),
}
_FRICTION = ("dry", "two_levels", "stribeck")


def formulas(feature: Feature, coefficients: np.ndarray, sigmas: np.ndarray) -> list[Formula]:
    """Formulas for a curve with coefficients (k,) and sigmas (k,), shortest description first."""
    if feature.memory:
        return []
    x = np.array(feature.knots)
    noise = np.hypot(np.minimum(sigmas, np.abs(coefficients).max() + 1e-12), CURVE_BLUR * np.ptp(coefficients) + 1e-12)
    found: list[tuple[float, Formula]] = []
    for key in _FRICTION if (feature.over, feature.factor) == ("velocity", "direction") else _OVER[feature.over]:
        family = FAMILIES[key]
        # a constant with a factor is a law of the factor alone
        if len(family.names) > len(x) or (key == "constant" and feature.factor):
            continue
        for start in family.starts(x, coefficients):
            fit = least_squares(
                lambda p, family=family: (family.shape(p, x) - coefficients) / noise, start, max_nfev=200
            )
            if not _within(family.key, fit.x, x):
                continue
            bits = 2.0 * fit.cost + len(family.names) * np.log(len(x))
            found.append((float(bits), Formula(family, fit.x).in_order()))
    ordered = [formula for _, formula in sorted(found, key=lambda item: item[0])]
    # several starts come to the same values
    return [one for index, one in enumerate(ordered) if not any(_alike(one, other) for other in ordered[:index])]


def _alike(one: Formula, other: Formula) -> bool:
    return one.family is other.family and np.allclose(one.values, other.values, rtol=1e-3, atol=1e-9)


def sharp_formulas(feature: Feature, kp: float) -> list[Formula]:
    """Formulas that bend within less than the knots of a feature's curve are apart: stops of a joint."""
    if (feature.port, feature.over, feature.factor) != ("torque", "position", ""):
        return []
    x = np.array(feature.knots)
    families = [FAMILIES[key] for key in _OVER["position"]]
    return [Formula(family, np.array(start)) for family in families for start in family.sharp(x, kp)]


def _within(key: str, values: np.ndarray, x: np.ndarray) -> bool:
    """Whether what a family speaks of lies where the data were: a bump far away is a line in disguise."""
    span = float(np.ptp(x))
    if key == "sine":
        return abs(values[1]) > np.pi / span
    if key in ("bump", "notch"):
        return x[0] <= values[1] <= x[-1] and abs(values[2]) < span
    if key in ("above", "below", "both"):
        return bool((x[0] < values[1:]).all() and (values[1:] < x[-1]).all())
    if key == "stribeck":
        return abs(values[1]) < span
    return key != "settling" or 0.0 < values[1] < 3.0 * span


def dense(feature: Feature, reached: tuple[float, float]) -> tuple[float, ...]:
    """Knots that are close enough for any formula of a feature's variable, over all that motion of the variable has
    `reached`, that of validation among it: where the formula goes on there is what it is validated on."""
    low, high = feature.knots[0], feature.knots[-1]
    if feature.over in ("velocity", "neighbour_velocity", "acceleration", "error"):
        half = max(FASTER * high, -reached[0], reached[1]) * np.geomspace(0.002, 1.0, DENSE_KNOTS // 2)
        return (*(-half[::-1]), 0.0, *half)
    if feature.over == "load":
        return (0.0, *(max(FASTER * high, reached[1]) * np.geomspace(0.002, 1.0, DENSE_KNOTS)))
    margin = 0.0 if feature.over in ("time", "heat") else BEYOND * (high - low)
    return tuple(np.linspace(min(low - margin, reached[0]), max(high + margin, reached[1]), DENSE_KNOTS))
