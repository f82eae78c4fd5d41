"""What a version says of the values that it was fitted to, where the recordings it came from are gone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from twin_daemon.changes.group import Believed
from twin_daemon.changes.thresholds import SHARED_SIGMA
from twin_daemon.estimation.thresholds import Z95
from twin_daemon.simulation.twin import TwinModel


class Stored(Protocol):
    """A number of a version with its interval, if that is known."""

    @property
    def value(self) -> float | None: ...
    @property
    def ci95(self) -> tuple[float, float] | None: ...


def believed(twin: TwinModel, parameters: Mapping[str, Stored]) -> Believed:
    """A belief about the twin's own values: as narrow as the version's intervals, as nominal ones where it has none.

    `twin` is the version's: every value stands at z = 0.
    """
    sigma: dict[str, float] = {}
    assumed = twin.hand.description.nominal_uncertainty
    for joint in twin.joints:
        for kind in ("damping", "frictionloss", "armature"):
            sigma[f"{joint}.{kind}"] = assumed.of(kind) or SHARED_SIGMA
    sigma |= {f"{servo}.kp": assumed.gain or SHARED_SIGMA for servo in twin.actuators}
    for name, one in parameters.items():
        if one.ci95 is None or one.value is None or one.value <= 0.0 or one.ci95[0] <= 0.0:
            continue
        sigma[name] = float(np.log(one.ci95[1] / one.ci95[0]) / (2.0 * Z95))
    return Believed({}, sigma)
