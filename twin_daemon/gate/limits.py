"""How far, how fast and how suddenly each command may move: the tightest of model, hand description and site."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.settings import CommandLimit, GateSettings
from twin_daemon.hand import Hand
from twin_daemon.signals.trajectory import RANGE_TOLERANCE_RAD, allowed_range


@dataclass(frozen=True, eq=False)
class Limits:
    """By command, all (c,): bounds rad, velocity rad/s, acceleration rad/s^2. `velocity` keeps the step limit, too:
    at the gate's rate no command is farther than `step_rad` from the one before. `margin` rad is how far a setpoint
    stays ahead of a hand that lets go."""

    names: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray
    margin: np.ndarray
    units: tuple[str, ...]
    """rad, or m for what slides: then all of it is in m."""
    unbounded: np.ndarray
    """(c,) bool: commands of which the description does not say how far or how fast. They are refused."""

    def clip(self, position: np.ndarray) -> np.ndarray:
        """Targets (c,) inside the bounds."""
        return np.minimum(np.maximum(position, self.lower), self.upper)


def limits_of(hand: Hand, settings: GateSettings) -> Limits:
    """The limits of every command of a hand. Raises BadInput for a site's limit that leaves or limits nothing."""
    for name in settings.limits:
        if name not in hand.commands:
            raise BadInput(f"gate.limits: no command '{name}'", todo=nearest(name, hand.commands))
    rows = [_row(hand, name, settings) for name in hand.commands]
    lower, upper, velocity, acceleration = np.array(rows, float).reshape(len(rows), 4).T
    margin = np.array([hand.hold_margin_rad(name) for name in hand.commands])
    units = tuple(hand.unit(name) for name in hand.commands)
    unbounded = np.array(~np.isfinite(np.stack([lower, upper, velocity, acceleration])).all(axis=0))
    # of what is not commanded no number matters, so long as it can be computed with
    velocity, acceleration = np.where(unbounded, 1.0, velocity), np.where(unbounded, 1.0, acceleration)
    return Limits(hand.commands, lower, upper, velocity, acceleration, margin, units, unbounded)


def _row(hand: Hand, name: str, settings: GateSettings) -> tuple[float, float, float, float]:
    site, unit = settings.limits.get(name, CommandLimit()), hand.unit(name)
    keys = ("lower", "upper", "velocity", "acceleration", "step")
    ends = ("", "", "_s", "_s2", "")
    given = [getattr(site, f"{key}_{unit}{end}") for key, end in zip(keys, ends, strict=True)]
    other = "m" if unit == "rad" else "rad"
    for key, end in zip(keys, ends, strict=True):
        if getattr(site, f"{key}_{other}{end}") is not None:
            raise BadInput(f"gate.limits.{name}.{key}_{other}{end}: this command is in {unit}")
    low, high = (float(bound) for bound in allowed_range(name, hand))
    fastest, sudden = hand.velocity_limit_rad_s(name), hand.acceleration_limit_rad_s2(name)
    least, most, velocity, acceleration, step = given
    rate = settings.rate_hz
    for key, value, loose, bound in (
        (f"lower_{unit}", least, least is not None and least < low - RANGE_TOLERANCE_RAD, f"{low:.4f} {unit} or more"),
        (f"upper_{unit}", most, most is not None and most > high + RANGE_TOLERANCE_RAD, f"{high:.4f} {unit} or less"),
        (f"velocity_{unit}_s", velocity, (velocity or 0.0) > fastest, f"{fastest:g} {unit}/s or less"),
        (f"acceleration_{unit}_s2", acceleration, (acceleration or 0.0) > sudden, f"{sudden:g} {unit}/s^2 or less"),
        (f"step_{unit}", step, (step or 0.0) * rate > fastest, f"{fastest / rate:.4f} {unit} or less at {rate:g} Hz"),
    ):
        if loose:
            degrees = " Angles are in rad: 30 degrees are 0.5236" if unit == "rad" else ""
            raise BadInput(
                f"gate.limits.{name}.{key}: {value:g} limits nothing, for the hand allows less already",
                allowed=bound,
                todo=f"Correct it, or leave it out.{degrees}",
            )
    low = low if least is None else max(low, least)
    high = high if most is None else min(high, most)
    if low >= high:
        raise BadInput(
            f"gate.limits.{name}: nothing is left between {low:.4f} and {high:.4f} {unit}",
            allowed="bounds that overlap those of the model",
            todo="Correct them; until then this hand cannot be commanded",
        )
    by_step = np.inf if step is None else step * rate
    shaped = min(fastest * settings.speed, by_step, np.inf if velocity is None else velocity)
    return low, high, shaped, min(sudden, np.inf if acceleration is None else acceleration)
