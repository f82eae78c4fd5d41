"""The library of physical effects: a readable list, cheapest explanation first."""

from __future__ import annotations

from twin_daemon.effects.base import Effect
from twin_daemon.effects.viscous_friction import ViscousFriction

_EFFECTS: tuple[Effect, ...] = (ViscousFriction(),)

LIBRARY: dict[str, Effect] = {effect.key: effect for effect in _EFFECTS}
"""Every effect by its key. The order is the order in which effects are written into a model."""
