"""Names of places that are neither a joint nor a command."""

from __future__ import annotations

HAND = "hand"
"""The whole, on its base."""

ROBOT = "robot"
"""A cause that is one for all servos: the same effect with the same values at each of them."""
