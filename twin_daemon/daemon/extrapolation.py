"""Whether the hand is, right now, where the version in use was fitted; beyond that its prediction is extrapolation."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np

from twin_daemon.comparison.region import UNITS, Quantity, Region, beyond, static_load
from twin_daemon.daemon.messages import number
from twin_daemon.simulation.twin import TwinModel


class Extrapolation:
    """Compares what the sensors say with the region of a version: `use` says which, none before it."""

    def __init__(self, twin: TwinModel) -> None:
        self._twin = twin
        self._data = mujoco.MjData(twin.model)  # made once: that takes longer than all that is asked of it
        self._region: Region | None = None

    def use(self, region: dict[str, Any] | None) -> None:
        """Takes a region as a version writes it; None where it has none, as older versions and the nominal model."""
        self._region = None if region is None else Region.model_validate(region)

    def at(self, position_rad: np.ndarray, velocity_rad_s: np.ndarray) -> dict[str, Any]:
        """What of joints at (j,) rad and (j,) rad/s, NaN where unknown, lies outside; the load as at rest there."""
        known = np.isfinite(position_rad)
        if self._region is None or not known.any():
            return {"known": self._region is not None, "outside": []}
        pose = self._twin.measurement.invert(self._twin.joints, np.nan_to_num(position_rad)[None])
        here: dict[Quantity, np.ndarray] = {
            "position": position_rad,
            "speed": np.abs(velocity_rad_s),
            "load": static_load(self._twin, pose, self._data)[0],
        }
        found = []
        for column in np.flatnonzero(known).tolist():
            joint = self._twin.joints[column]
            fitted = self._region.joints.get(joint)
            for quantity, unit in UNITS.items() if fitted else ():
                value, seen = here[quantity][column], getattr(fitted, quantity)
                if beyond(seen, quantity, np.array([value]))[0]:
                    found.append(
                        {"joint": joint, "quantity": quantity, "unit": unit, "here": number(value), "seen": list(seen)}
                    )
        return {"known": True, "outside": found}


def outside_in_words(region: dict[str, Any]) -> list[str]:
    """One line for each quantity that `at` has found outside."""
    return [
        f"{one['joint']}: {one['quantity']} {one['here']:.3g} {one['unit']}, fitted in {one['seen'][0]:.3g} to "
        f"{one['seen'][1]:.3g}"
        for one in region["outside"]
    ]
