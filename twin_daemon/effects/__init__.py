"""The library of physical effects, cheapest explanation first: one file each, found by its place in this folder.

Beside them stand those of a user (see `discovery`). The order is the order in which effects are written into a
model; each declares its rank.
"""

from __future__ import annotations

from threading import Lock

from twin_daemon.effects.base import Effect
from twin_daemon.effects.discovery import built_in, from_files, user_effects

BUILT_IN: dict[str, Effect] = {effect.key: effect for effect in built_in()}
"""The effects that come with the program."""

LIBRARY: dict[str, Effect] = {
    effect.key: effect
    for effect in sorted([*BUILT_IN.values(), *user_effects(BUILT_IN)], key=lambda effect: (effect.rank, effect.key))
}
"""Every effect by its key, a user's own among them."""


def reload_files() -> dict[str, str]:
    """Takes the effects that are files of the state folder into the library, and those out that are gone.

    What stays is in the library all the while, for other threads that look it up. Returns what is wrong with those that
    cannot be used, by key, each in one line.
    """
    with _RELOADING:
        usable, broken = from_files(LIBRARY.keys() - _FROM_FILES)
        LIBRARY.update(usable)
        for key in _FROM_FILES - usable.keys():
            del LIBRARY[key]
        _FROM_FILES.clear()
        _FROM_FILES.update(usable)
    return broken


_FROM_FILES: set[str] = set()
_RELOADING = Lock()
reload_files()
