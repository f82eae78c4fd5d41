"""The sensor's zero is off."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from twin_daemon.effects.base import Effect, Measurement, Parameter, Place, Scale, Story


class SensorOffset(Effect):
    """reading = angle + offset. It lies in the measurement model; the mechanics stay as they are."""

    key = "sensor_offset"
    title = "the sensor's zero is off"
    acts_on = "sensor"
    rank = 10
    stands_for = "offset"
    parameters = (Parameter("offset", "rad", -np.pi, np.pi, 0.0, 0.03, "reading at angle 0"),)
    story = Story(
        what="Every reading is wrong by the same angle.",
        shows="A constant error, at rest and in motion, at every angle and speed, at the stops too.",
        cause="A calibration that was skipped, a magnet that has slipped.",
        remedy="Calibrate the joint at two known angles.",
        excitation="the joint's stops, or a known pose",
    )
    confusable = ("spring", "sensor_gain", "joint_stop")

    def measure(self, measurement: Measurement, place: Place, values: Mapping[str, float]) -> None:
        offset = measurement.offset_rad.get(place.target, 0.0)
        measurement.offset_rad[place.target] = offset + values["offset"]

    def starts(self, scale: Scale) -> tuple[dict[str, float], ...]:
        return tuple({"offset": offset} for offset in (0.02, -0.02, 0.1, -0.1))
