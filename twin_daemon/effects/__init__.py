"""The library of physical effects, cheapest explanation first: one file each, found by its place in this folder.

Beside them stand those of a user (see `discovery`). The order is the order in which effects are written into a
model; each declares its rank.
"""

from __future__ import annotations

from twin_daemon.effects.base import Effect
from twin_daemon.effects.discovery import built_in, user_effects

BUILT_IN: dict[str, Effect] = {effect.key: effect for effect in built_in()}
"""The effects that come with the program."""

LIBRARY: dict[str, Effect] = {
    effect.key: effect
    for effect in sorted([*BUILT_IN.values(), *user_effects(BUILT_IN)], key=lambda effect: (effect.rank, effect.key))
}
"""Every effect by its key, a user's own among them."""
