"""How strong an effect is: its rms response at its joint over the floor there, and the size that gives a wanted one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .laws import Law
from .plants import Plant, Unstable

NOMINAL_SIGMA = 0.12  # of dampings, frictions, armatures and gains, as the product assumes where nobody says otherwise
_CLOSE = 0.1  # of the wanted ratio, in natural logarithms
_RUNS = 9


def rms(difference: np.ndarray) -> np.ndarray:
    """(j,) rms over the rows of (n, j)."""
    return np.sqrt(np.mean(np.square(difference), axis=0))


def response(law: Law, read: np.ndarray, sound: np.ndarray, floor: np.ndarray) -> float:
    """Rms of what the law changes in the readings (n, j), over the floor (j,) rad, at the place where it acts.

    `read` is with the law, `sound` without. Of a law of no library only that part counts which no simple law takes: an
    offset, a spring, friction, inertia or a late command would be a fair name for the rest. A tendon counts by the
    joint that shows it most, a load by the joint of its chain; a law of the whole robot by the median joint, a tilt by
    the upper quartile, since gravity does not reach every joint.
    """
    difference = read - sound
    if law.foreign:
        difference = np.column_stack([_beyond(*columns) for columns in zip(difference.T, sound.T, strict=True)])
    ratios = rms(difference) / floor
    if law.at == "robot":
        return float(np.quantile(ratios, 0.75 if law.key == "gravity_tilt" else 0.5))
    names = law.site.robot.joints
    return float(max(ratios[names.index(place)] for place in law.places if place in names))


def told(law: Law, ratio: float) -> float:
    """A law's strength: its response over the floor, of which what nobody knows of the model's numbers is a part.

    A gain that is one standard deviation of nominal gains off is not told from a servo that is as it should be, however
    well it can be seen.
    """
    change = law.nominal_change()
    if change is None or ratio <= 0.0:
        return ratio
    return float(1.0 / np.hypot(1.0 / ratio, NOMINAL_SIGMA / max(change, 1e-12)))


def _beyond(difference: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(n,) what is left of a joint's difference after a regression on what simple laws do to a stiff servo's joint."""
    speed = np.gradient(angle)
    simple = np.column_stack([np.ones_like(angle), angle, speed, np.gradient(speed), np.sign(speed)])
    simple /= np.linalg.norm(simple, axis=0) + 1e-12
    return difference - simple @ np.linalg.lstsq(simple, difference, rcond=None)[0]


def calibrated(
    law: Law, plant: Plant, targets: np.ndarray, sound: np.ndarray, floor: np.ndarray, wanted: float
) -> float:  # fmt: skip
    """Sets the law's size so that its strength (`told`) is about `wanted`; returns the strength that was reached.

    `sound` (n, j) is the plant without it. The largest size that a robot could have may fall short of the ratio.
    """

    def ratio(log_size: float) -> float:
        law.size = float(np.exp(log_size))
        try:
            return told(law, response(law, plant.run(targets, [law]), sound, floor))
        except Unstable:
            return np.inf

    low, high = np.log(law.sizes)
    size, reached = _search(ratio, float(low), float(high), wanted)
    law.size = float(np.exp(size))
    return reached


def _search(ratio: Callable[[float], float], low: float, high: float, wanted: float) -> tuple[float, float]:
    """(log size, ratio) nearest to the wanted one: secants in logarithms inside a bracket that shrinks."""
    x, best = (low + high) / 2, (low, 0.0)
    known: list[tuple[float, float]] = []
    for _ in range(_RUNS):
        value = ratio(x)
        if np.isfinite(value) and value > 0 and _off(value, wanted) < _off(best[1], wanted):
            best = (x, value)
        if _off(value, wanted) < _CLOSE:
            break
        if value < wanted:
            low = x
        else:
            high = x
        known.append((x, value))
        if high - low < 1e-3:
            break
        x = _next(known, low, high, wanted)
    return best


def _next(known: list[tuple[float, float]], low: float, high: float, wanted: float) -> float:
    sound = [(x, np.log(value)) for x, value in known if 1e-3 * wanted < value < np.inf]
    if not sound:
        return (low + high) / 2
    sound.sort(key=lambda one: abs(one[1] - np.log(wanted)))
    slope = 1.0
    if len(sound) > 1 and abs(sound[0][0] - sound[1][0]) > 1e-6:
        slope = float(np.clip((sound[0][1] - sound[1][1]) / (sound[0][0] - sound[1][0]), 0.3, 6.0))
    guess = sound[0][0] + (np.log(wanted) - sound[0][1]) / slope
    margin = 0.02 * (high - low)
    return float(np.clip(guess, low + margin, high - margin))


def _off(value: float, wanted: float) -> float:
    return abs(np.log(value / wanted)) if 0 < value < np.inf else np.inf
