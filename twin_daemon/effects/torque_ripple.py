"""A torque that comes and goes with the angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Reach, Scale, Seen, Story
from twin_daemon.effects.edits import add_passive_motor
from twin_daemon.minimum import lowest

_FEWEST, _MOST = 3.0, 120.0  # waves a turn that are looked for
_LEAST_TRAVEL_RAD = 0.2
_PEAKS = 4
_FIRST = 2  # of them that are tried at other heights than what shows too
_SNAPPING = 3.0  # times it: steeper than the servo, a wave is jumped over for the most part
_GENTLE = 0.5  # times it: where the servo is near its limit of torque, a little more runs away


class TorqueRipple(Effect):
    """Torque amplitude * sin(periods * angle + phase): cogging of a `dcmotor` without input, beside the servo."""

    key = "torque_ripple"
    title = "a torque that comes and goes with the angle"
    acts_on = "actuator"
    rank = 180
    parameters = (
        Parameter("amplitude", "N m", 0.0, 5.0, 0.0, 0.1, "largest torque", reach=Reach("kp", 0.5)),
        Parameter("phase", "rad", -2.0 * np.pi, 2.0 * np.pi, 0.0, 0.0, "phase at angle 0", place=True),
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

        Its waves are those of a torque as the servo lets them through. Where a wave is steeper than the servo, the
        joint snaps from one valley to the next and hardly shows what is between.
        """
        travel = float(np.ptp(seen.angle))
        if travel < _LEAST_TRAVEL_RAD:
            return ()
        spectrum = _Spectrum(scale, seen)
        step = 0.25 * 2.0 * np.pi / travel
        fewest = max(_FEWEST, 2.0 * np.pi / travel)  # less than a wave over the travel is a spring
        periods = np.arange(fewest, _MOST, step)
        power = -np.array([spectrum.wave(count)[0] for count in periods])
        beside = np.pad(power, 1, constant_values=-np.inf)
        peaks = np.flatnonzero((power >= beside[:-2]) & (power >= beside[2:]))
        best = peaks[np.argsort(-power[peaks])][:_PEAKS]
        # between two of the grid a wave may be 0.4 rad off at the ends of the travel
        exact = [spectrum.closest(float(periods[i]), step) for i in best]
        waves = [(count, *spectrum.wave(count)[1:]) for count in exact]
        begun = [(1.0, wave) for wave in waves]
        begun += [(times, wave) for wave in waves[:_FIRST] for times in (_SNAPPING, _GENTLE)]
        return tuple(
            {"amplitude": times * height, "phase": phase, "periods": count} for times, (count, height, phase) in begun
        )

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        weak = 0.01 * scale.kp
        thirds = [0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0]
        return tuple({"amplitude": a, "phase": p, "periods": 24.0} for a in (weak, 4.0 * weak) for p in thirds)


class _Spectrum:
    """Waves over the angle in a gap, beside what a load, a stiffness and both frictions do to it.

    What is further off than three times the typical error, as in fast motion, counts as that.
    """

    def __init__(self, scale: Scale, seen: Seen) -> None:
        self._angle, self._response = seen.angle, seen.response(scale)
        way = np.sign(seen.speed) * (np.abs(seen.speed) > np.median(np.abs(seen.speed)))
        self._beside = np.stack([np.ones_like(seen.angle), seen.angle, seen.speed, way])
        off = seen.gap - self._beside.T @ np.linalg.lstsq(self._beside.T, seen.gap, rcond=None)[0]
        limit = 3.0 * float(np.median(np.abs(off))) + 1e-9
        self._gap = np.clip(off, -limit, limit)

    def wave(self, periods: float) -> tuple[float, float, float]:
        """(what is left, rad^2; height, N m; phase at angle 0) of the best wave of so many periods a radian."""
        torques = np.sin(periods * self._angle), np.cos(periods * self._angle)
        waves = np.stack([*map(self._response, torques), *self._beside], axis=1)
        weights, *_ = np.linalg.lstsq(waves, self._gap, rcond=None)
        left = self._gap - waves @ weights
        return float(left @ left), float(np.hypot(*weights[:2])), float(np.arctan2(weights[1], weights[0]))

    def closest(self, periods: float, step: float) -> float:
        """The periods a radian, within a step of some, that leave least."""
        return lowest(lambda count: self.wave(count)[0], periods - step, periods + step, 1e-5)
