"""Whether a version is worse than another one on data that both know.

Each version says how well it did on its recordings, and how well the version did that it was made from. Together these
are what is known of the errors of many versions on one set of recordings, without simulating anything again.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from twin_daemon.versions.version import NOMINAL, Version

_HELD_OUT, _FITTED = "held out", "fitted"


@dataclass(frozen=True)
class Data:
    """Motion that an error is of: recordings by their bytes, whole or the same stretches of each, and the joints."""

    role: str
    recordings: frozenset[str]
    stretches: bool
    joints: frozenset[str] | None  # None in versions of earlier releases, which did not say


@dataclass(frozen=True)
class Worse:
    """The mean squared errors (rad^2) of a version and of another one, on recordings (names) that both know."""

    mse_rad2: float
    other_rad2: float
    held_out: bool
    recordings: tuple[str, ...]

    @property
    def words(self) -> str:
        motion = "held-out motion" if self.held_out else "the motion that it was fitted to"
        names = ", ".join(self.recordings)
        return f"{self.mse_rad2:.4g} rad² against {self.other_rad2:.4g} rad² on {motion} of {names}"


Known = dict[str, dict[Data, float]]
"""Errors in rad^2 by version and data."""


def worse_than(version: Version, other: Version, known: Known) -> Worse | None:
    """How much worse a version is than another; None where it is not, or where no data are known to both.

    Held-out motion counts before motion that was fitted.
    """
    own, theirs = known.get(version.id, {}), known.get(other.id, {})
    for role in (_HELD_OUT, _FITTED):
        shared = [(own[data], theirs[data]) for data in own.keys() & theirs.keys() if data.role == role]
        if shared:
            new, old = (sum(errors) / len(shared) for errors in zip(*shared, strict=True))
            return Worse(new, old, role == _HELD_OUT, _names(version, other, role)) if new > old else None
    return None


def known_errors(versions: Iterable[Version]) -> Known:
    """What versions say of themselves and of those that they were made from."""
    found: Known = {}
    for version in versions:
        for role, prefix, used in ((_HELD_OUT, "holdout_", version.held_out_on), (_FITTED, "", version.fitted_on)):
            joints = version.errors.get("joints")
            data = Data(
                role,
                frozenset(one.sha256 for one in used),
                stretches=version.fitted_on == version.held_out_on,
                joints=None if joints is None else frozenset(joints),
            )
            of_parent = "given" if f"{prefix}given" in version.errors else "before"
            for own, when in ((version.id, "after"), (version.parent or NOMINAL, of_parent)):
                mse = version.mse_rad2(f"{prefix}{when}")
                if mse is not None and data.recordings:
                    found.setdefault(own, {}).setdefault(data, mse)
    return found


def _names(version: Version, other: Version, role: str) -> tuple[str, ...]:
    used = [one for v in (version, other) for one in (v.held_out_on if role == _HELD_OUT else v.fitted_on)]
    return tuple(sorted({one.name for one in used}))
