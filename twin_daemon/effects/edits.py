"""Edits of an MjSpec that several effects share."""

from __future__ import annotations

from typing import Any

import numpy as np

from twin_daemon.effects.base import Place
from twin_daemon.errors import BadInput


def linear(element: Any, attribute: str) -> float:
    """A coefficient of an element, or the linear one where MuJoCo has a polynomial."""
    return float(np.ravel(getattr(element, attribute))[0])


def add_to_linear(element: Any, attribute: str, amount: float, place: Place) -> None:
    """Adds to a coefficient that physics keeps at 0 or above. Raises BadInput below it."""
    total = linear(element, attribute) + amount
    if total < 0.0:
        raise BadInput(
            f"{place.target}: {attribute} would be {total:g}, and negative {attribute} feeds energy in",
            allowed=f"at least {-linear(element, attribute):g} beside the model's own",
        )
    current = getattr(element, attribute)
    if np.ndim(current):
        current[0] = total
    else:
        setattr(element, attribute, total)
