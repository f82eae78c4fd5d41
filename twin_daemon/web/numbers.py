"""Arrays as a page reads them."""

from __future__ import annotations

from typing import Any

import numpy as np


def listed(values: np.ndarray, digits: int) -> list[Any]:
    """Nested lists of numbers to so many decimals, with null for what is not known."""
    rounded = np.round(values.astype(float), digits).astype(object)
    rounded[~np.isfinite(values)] = None
    return rounded.tolist()
