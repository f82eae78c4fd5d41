"""What a comparison of two sessions says, as it is written and read. Unknown numbers are NaN here and null in JSON."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict

from twin_daemon.diagnosis.verdict import Diagnosis, RecordingRead
from twin_daemon.estimation.estimate import Number, with_unit


class _Said(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)


class Valued(_Said):
    """A number with its 95 % interval."""

    value: Number
    ci95: tuple[Number, Number]


BY_TEMPERATURE = "temperature:robot"
"""Among the rivals of a change: a colder or a warmer day, which no effect of the library is."""


def rivals_in_words(rivals: Sequence[str]) -> str:
    """What explains the same as a change, in words."""
    return ", ".join("a colder or a warmer day" if rival == BY_TEMPERATURE else rival for rival in rivals)


UNKNOWN = Valued(value=np.nan, ci95=(np.nan, np.nan))


def sentence(
    effect: str,
    joints: Sequence[str],
    unit: str,
    before: Valued,
    now: Valued,
    ratio: Valued,
    first_seen: str,
    probability: float,
) -> str:
    """A change in one plain sentence: in percent where it has a ratio, else from what to what."""
    what, where = effect.replace("_", " "), ", ".join(joints)
    if np.isfinite(ratio.value):
        low, high = (f"{100.0 * (end - 1.0):+.0f}" for end in ratio.ci95)
        size = f"{100.0 * (ratio.value - 1.0):+.0f} % ({low} to {high} %)"
    else:
        there = f"{before.value:.3g}" if np.isfinite(before.value) else "none"
        size = f"{there} -> {with_unit(f'{now.value:.3g}', unit)} ({now.ci95[0]:.3g} to {now.ci95[1]:.3g})"
    return f"{where}: {what} {size} by {first_seen[:10]}, probability {probability:.2f}"


class Change(_Said):
    """What is another one since. `parameter` is the number that has changed and `effect` the cause it stands for.

    `before` and `now` are in `unit`; `ratio` is now over before, unknown where there was none of it. `probability` is
    that this has changed, `rivals` what explains the same. `first_seen` is when the first recording that shows it
    began, UTC; `remedy` what to do about it.
    """

    effect: str
    parameter: str
    target: str
    joints: tuple[str, ...]
    unit: str
    before: Valued
    now: Valued
    ratio: Valued
    probability: float
    rivals: tuple[str, ...] = ()
    first_seen: str | None = None
    words: str
    remedy: str = ""


class Unchanged(_Said):
    """What has not changed though it could have been seen, from `least_ratio` (up) or from an amount `least` in `unit`
    that would have been there."""

    effect: str
    parameter: str
    joints: tuple[str, ...]
    unit: str
    least_ratio: float | None
    least: float | None


class Undetectable(_Said):
    """What may have changed without these recordings showing it."""

    effect: str
    parameter: str
    joints: tuple[str, ...]
    why: str


class Since(Diagnosis):
    """A diagnosis of a later session beside an earlier one: the recordings of that, or the version in its place."""

    changes: tuple[Change, ...] = ()
    unchanged: tuple[Unchanged, ...] = ()
    undetectable: tuple[Undetectable, ...] = ()
    baseline: tuple[RecordingRead, ...] = ()
    since_version: str | None = None
    spread_between_sessions: float | None = None
    """How much a value differs between sessions without wear, learnt from the versions; None of fewer than three."""
