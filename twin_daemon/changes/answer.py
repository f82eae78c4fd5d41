"""What a comparison of two sessions says, as it is written and read. Unknown numbers are NaN here and null in JSON."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict

from twin_daemon.diagnosis.verdict import Diagnosis, RecordingRead
from twin_daemon.estimation.estimate import Number


class _Said(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore", populate_by_name=True)


class Valued(_Said):
    """A number with its 95 % interval."""

    value: Number
    ci95: tuple[Number, Number]


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
