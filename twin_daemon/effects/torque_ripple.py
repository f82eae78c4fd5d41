"""A torque that comes and goes with the angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.optimize import minimize_scalar

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_passive_motor

_FEWEST, _MOST = 3.0, 120.0  # waves a turn that are looked for
_LEAST_TRAVEL_RAD = 0.2
_PEAKS = 4
_SNAPS = 2  # of them that are tried as strong ones too
_SNAPPING = 3.0  # times the height that shows: steeper than the servo, a wave is jumped over for the most part


class TorqueRipple(Effect):
    """Torque amplitude * sin(periods * angle + phase): cogging of a `dcmotor` without input, beside the servo."""

    key = "torque_ripple"
    title = "a torque that comes and goes with the angle"
    acts_on = "actuator"
    rank = 180
    parameters = (
        Parameter("amplitude", "N m", 0.0, 5.0, 0.0, 0.1, "largest torque", reach=Reach("kp", 0.5)),
        Parameter("phase", "rad", -2.0 * np.pi, 2.0 * np.pi, 0.0, 0.0, "phase at angle 0"),
        Parameter("periods", "1/turn", 1.0, 500.0, 24.0, 24.0, "waves a turn of the joint", held=True),
    )
    story = Story(
        what="The motor pulls towards certain angles and away from others, again and again along the travel.",
        shows="A wave in the error over the angle, the same at every pass, in both directions.",
        cause="Cogging of the motor, a gear tooth that is damaged, a drum that runs out of true.",
        remedy="Count the waves a turn: they name the wheel; look at its teeth.",
        excitation="slow motion across a wide range, in both directions",
    )
    confusable = ("nonlinear_spring", "sensor_gain")

    def edit(self, spec: Any, place: Place, values: Mapping[str, float]) -> None:
        servo = spec.actuator(place.actuator)
        motor = add_passive_motor(spec, f"{place.actuator}_ripple", servo.trntype, servo.target)
        motor.gear = servo.gear
        motor.biasprm = np.array([values["amplitude"], values["periods"], values["phase"], *np.zeros(7)])

    def suggested(self, scale: Scale, seen: Seen) -> tuple[dict[str, float], ...]:
        """The highest peaks of the gap's least-squares spectrum over the angle (Lomb 1976).

        The servo is a spring, so that a torque shows as its part of the stiffness, wherever motion is slow. Where a
        wave is steeper than that spring, the joint snaps from one valley to the next and hardly shows what is between.
        """
        angle, gap = seen.angle, seen.gap
        limit = 3.0 * float(np.median(np.abs(gap - np.median(gap)))) + 1e-9
        gap = np.clip(gap - np.median(gap), -limit, limit)
        travel = float(np.ptp(angle))
        if travel < _LEAST_TRAVEL_RAD:
            return ()
        step = 0.25 * 2.0 * np.pi / travel
        fewest = max(_FEWEST, 2.0 * np.pi / travel)  # less than a wave over the travel is a spring
        periods = np.arange(fewest, _MOST, step)
        size = np.array([_wave(angle, gap, count)[0] for count in periods])
        beside = np.pad(size, 1)
        peaks = np.flatnonzero((size >= beside[:-2]) & (size >= beside[2:]))
        best = peaks[np.argsort(-size[peaks])][:_PEAKS]
        # between two of the grid a wave may be 0.4 rad off at the ends of the travel
        exact = [_highest(angle, gap, periods[i] - step, periods[i] + step) for i in best]
        times = [(count, 1.0) for count in exact] + [(count, _SNAPPING) for count in exact[:_SNAPS]]
        waves = [(count, more, *_wave(angle, gap, count)) for count, more in times]
        return tuple(
            {"amplitude": more * scale.kp * height, "phase": phase, "periods": count}
            for count, more, height, phase in waves
        )

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        weak = 0.01 * scale.kp
        thirds = [0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0]
        return tuple({"amplitude": a, "phase": p, "periods": 24.0} for a in (weak, 4.0 * weak) for p in thirds)


def _wave(angle: np.ndarray, gap: np.ndarray, periods: float) -> tuple[float, float]:
    """(height, phase at angle 0) of the wave over angles (n,) rad that fits gaps (n,) rad best."""
    waves = np.stack([np.sin(periods * angle), np.cos(periods * angle), np.ones_like(angle)], axis=1)
    (sine, cosine, _), *_ = np.linalg.lstsq(waves, gap, rcond=None)
    return float(np.hypot(sine, cosine)), float(np.arctan2(cosine, sine))


def _highest(angle: np.ndarray, gap: np.ndarray, fewest: float, most: float) -> float:
    """The waves a radian of the highest wave between two counts."""
    found = minimize_scalar(lambda count: -_wave(angle, gap, count)[0], bounds=(fewest, most), method="bounded")
    return float(found.x)
