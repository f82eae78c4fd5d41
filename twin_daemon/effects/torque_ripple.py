"""A torque that comes and goes with the angle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin_daemon.effects.base import Effect, Parameter, Place, Scale, Story
from twin_daemon.effects.edits import add_passive_motor


class TorqueRipple(Effect):
    """Torque amplitude * sin(periods * angle + phase): cogging of a `dcmotor` without input, beside the servo."""

    key = "torque_ripple"
    title = "a torque that comes and goes with the angle"
    acts_on = "actuator"
    parameters = (
        Parameter("amplitude", "N m", 0.0, 5.0, 0.0, 0.1, "largest torque"),
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

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        weak = 0.01 * scale.kp
        thirds = [0.0, 2.0 * np.pi / 3.0, -2.0 * np.pi / 3.0]
        return tuple({"amplitude": a, "phase": p, "periods": 24.0} for a in (weak, 4.0 * weak) for p in thirds)
