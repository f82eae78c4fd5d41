"""What crosses the border between a transport and the daemon, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

_NOTHING = np.zeros(0)
ROS_SOURCE = "ros2:"
"""What the source of a message begins with that came under a ROS 2 system's key."""


class MalformedPayload(Exception):
    """Bytes that are not the message they claim to be. `kind` is the counter that they go to."""

    def __init__(self, kind: str, why: str) -> None:
        self.kind = kind
        super().__init__(why)


@dataclass(frozen=True)
class JointSample:
    """A decoded joint state or joint command, not yet trusted: lengths, names and numbers may be anything.

    `position` (k,) rad, `velocity` (k,) rad/s, `effort` (k,) in the driver's units; the last two may be empty.
    `source` is who published it, as the transport tells; "" where it does not.
    """

    stamp_ns: int
    names: tuple[str, ...]
    position: np.ndarray
    velocity: np.ndarray = field(default_factory=lambda: _NOTHING)
    effort: np.ndarray = field(default_factory=lambda: _NOTHING)
    source: str = ""


@dataclass(frozen=True)
class Output:
    """What one accepted joint state leads to: the prediction for its stamp, and whether its residual is due.

    The residual is put into words after the prediction has gone out.
    """

    prediction: JointSample
    residual_due: bool = False


def number(value: float) -> float | None:
    """A float for JSON: undefined and infinite become null."""
    value = float(value)
    return value if math.isfinite(value) else None
