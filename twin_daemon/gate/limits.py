"""How far, how fast and how suddenly each command may move: the tightest of model, hand description and site."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from twin_daemon.errors import BadInput, nearest
from twin_daemon.gate.settings import CommandLimit, GateSettings
from twin_daemon.hand import Hand
from twin_daemon.signals.trajectory import allowed_range


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

    def clip(self, position: np.ndarray) -> np.ndarray:
        """Targets (c,) inside the bounds."""
        return np.minimum(np.maximum(position, self.lower), self.upper)


def limits_of(hand: Hand, settings: GateSettings) -> Limits:
    """The limits of every command of a hand. Raises BadInput where the site's leave nothing."""
    for name in settings.limits:
        if name not in hand.commands:
            raise BadInput(f"gate.limits: no command '{name}'", todo=nearest(name, hand.commands))
    rows = [_row(hand, name, settings) for name in hand.commands]
    columns = np.array(rows, float).reshape(len(rows), 4).T
    margin = np.array([hand.hold_margin_rad(name) for name in hand.commands])
    lower, upper, velocity, acceleration = columns
    return Limits(hand.commands, lower, upper, velocity, acceleration, margin)


def _row(hand: Hand, name: str, settings: GateSettings) -> tuple[float, float, float, float]:
    site = settings.limits.get(name, CommandLimit())
    low, high = (float(bound) for bound in allowed_range(name, hand))
    low = low if site.lower_rad is None else max(low, site.lower_rad)
    high = high if site.upper_rad is None else min(high, site.upper_rad)
    if low >= high:
        raise BadInput(
            f"gate.limits.{name}: nothing is left between {low:.4f} and {high:.4f} rad",
            allowed="bounds that overlap those of the model",
            todo="Correct them; until then this hand cannot be commanded",
        )
    fastest = hand.velocity_limit_rad_s(name) * settings.speed
    by_step = np.inf if site.step_rad is None else site.step_rad * settings.rate_hz
    velocity = np.inf if site.velocity_rad_s is None else site.velocity_rad_s
    acceleration = np.inf if site.acceleration_rad_s2 is None else site.acceleration_rad_s2
    return low, high, min(fastest, by_step, velocity), min(hand.acceleration_limit_rad_s2(name), acceleration)
