"""Groups of joints that are named, reported and fitted together."""

from __future__ import annotations

import re
from collections.abc import Iterable

from .naming import canonical

_SHADOW = re.compile(r"^(?P<digit>FF|MF|RF|LF|TH|WR)J(?P<number>[0-5])$")
_DIGIT_GROUP = {"FF": "FF", "MF": "MF", "RF": "RF", "LF": "LF", "TH": "thumb", "WR": "wrist"}


def derive_groups(joints: Iterable[str]) -> dict[str, list[str]]:
    """Groups that follow from the names: FJ1..FJ4, FF, MF, RF, LF, thumb, wrist, fingers, hand (for Shadow-like names).

    `hand` is everything but the wrist. `all` is there for any robot.
    """
    names = list(joints)
    groups: dict[str, list[str]] = {}
    for name in names:
        parts = _SHADOW.match(canonical(name))
        if parts is None:
            continue
        digit = parts["digit"]
        groups.setdefault(_DIGIT_GROUP[digit], []).append(name)
        if digit not in ("TH", "WR"):
            groups.setdefault("fingers", []).append(name)
            if parts["number"] in "1234":
                groups.setdefault(f"FJ{parts['number']}", []).append(name)
        if digit != "WR":
            groups.setdefault("hand", []).append(name)
    order = ["FJ1", "FJ2", "FJ3", "FJ4", "FF", "MF", "RF", "LF", "thumb", "wrist", "fingers", "hand"]
    return {key: groups[key] for key in order if key in groups} | {"all": names}
