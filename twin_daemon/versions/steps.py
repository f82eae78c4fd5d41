"""The errors on the way from the nominal model to a version, one step for each version on it."""

from __future__ import annotations

from dataclasses import dataclass

from twin_daemon.versions.store import VersionStore
from twin_daemon.versions.version import Version

_LONGEST = 64


@dataclass(frozen=True)
class Step:
    """What was added, by which version (None: the model before all), and the mean squared errors (rad^2) after it."""

    title: str | None
    version: Version | None
    mse_rad2: float | None
    holdout_mse_rad2: float | None


def error_steps(store: VersionStore, version: Version) -> list[Step]:
    """From the nominal model on; versions that no fit has made are no steps of it."""
    chain = [version]
    while chain[0].parent and len(chain) < _LONGEST:
        chain.insert(0, store.get(chain[0].parent))
    chain = [one for one in chain if error_of(one, "after") is not None] or [version]
    first = chain[0]
    steps = [Step(None, None, error_of(first, "before"), error_of(first, "holdout_before"))]
    for one in chain:
        steps.append(Step(one.title or one.kind, one, error_of(one, "after"), error_of(one, "holdout_after")))
    return steps


def error_of(version: Version, name: str) -> float | None:
    """A mean squared error (rad^2) that was kept with a version: before, after, holdout_before or holdout_after."""
    value = (version.errors.get(name) or {}).get("mse_rad2")
    return float(value) if isinstance(value, (int, float)) else None
