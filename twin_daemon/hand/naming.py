"""One joint, many spellings: rh_FFJ3 in the data, rh_A_FFJ3 the actuator, FFJ3 in a configuration.

A name is a side (rh_, lh_ or none), an optional actuator mark (A_) and the bare joint name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

_PARTS = re.compile(r"^(?P<side>[rl]h_)?(?P<mark>A_)?(?P<bare>.+)$")


def _split(name: str) -> tuple[str, str]:
    """`name` as (side, bare name); the actuator mark is dropped."""
    parts = _PARTS.match(name)
    return ("", name) if parts is None else (parts["side"] or "", parts["bare"])


def canonical(name: str) -> str:
    """The bare name: "FFJ3" for rh_A_FFJ3, rh_FFJ3, lh_FFJ3 and FFJ3. Names of other robots stay as they are."""
    return _split(name)[1]


def side(name: str) -> str:
    """The prefix of the hand that `name` belongs to: "rh_", "lh_" or ""."""
    return _split(name)[0]


def match(name: str, candidates: Iterable[str]) -> str | None:
    """The one candidate that means the same joint as `name`: itself if it is there, else the same bare name.

    A right hand never matches a left one. Where two candidates fit equally well there is no match: guessing would
    drive the wrong joint.
    """
    known = list(candidates)
    if name in known:
        return name
    own_side, bare = _split(name)
    fits = [other for other in known if _compatible((own_side, bare), _split(other))]
    return fits[0] if len(fits) == 1 else None


def _compatible(one: tuple[str, str], other: tuple[str, str]) -> bool:
    sides_differ = one[0] and other[0] and one[0] != other[0]
    return one[1] == other[1] and not sides_differ
