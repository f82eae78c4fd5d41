"""Where a function of one value is lowest."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


def lowest(error: Callable[[float], float], low: float, high: float, tolerance: float) -> float:
    """Where an error is lowest between two bounds, to a tolerance in its argument, by Brent's bounded method."""
    # not at the top: a daemon and a gate know what asks for this, and start half a second earlier without an optimiser
    from scipy.optimize import minimize_scalar

    found: Any = minimize_scalar(error, bounds=(low, high), method="bounded", options={"xatol": tolerance})
    return float(found.x)
