"""The sensor's scale is off."""

from __future__ import annotations

from collections.abc import Mapping

from twin_daemon.effects.base import Effect, Measurement, Parameter, Place, Scale, Story


class SensorGain(Effect):
    """reading = factor * angle. It lies in the measurement model; the mechanics stay as they are."""

    key = "sensor_gain"
    title = "the sensor's scale is off"
    acts_on = "sensor"
    rank = 20
    parameters = (Parameter("factor", "1", 0.2, 5.0, 1.0, 1.05, "reading over angle", log=True),)
    story = Story(
        what="Every reading is wrong by the same share of the angle.",
        shows="An error that grows with the angle, at rest and in motion alike, and never with speed or direction.",
        cause="A calibration table of another joint, a magnet at another distance.",
        remedy="Calibrate the joint at two known angles.",
        excitation="holds across the whole range",
    )
    confusable = ("sensor_offset", "spring", "actuator_gain")

    def measure(self, measurement: Measurement, place: Place, values: Mapping[str, float]) -> None:
        measurement.gain[place.target] = measurement.gain.get(place.target, 1.0) * values["factor"]

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"factor": factor} for factor in (0.95, 1.05, 0.8, 1.2))
