"""What `twin propose` says, as it is written and read."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict

from twin_daemon.estimation.estimate import Number


class _Said(BaseModel):
    model_config = ConfigDict(frozen=True, extra="ignore")


class Value(_Said):
    """One value of a formula with its 95 % interval."""

    value: Number
    ci95: tuple[Number, Number]


class Curve(_Said):
    """A law as a curve: values (k,) in `unit` at `at` (k,) in `at_unit`, with a 95 % band; flat beyond.

    `visited` is where the motion has been: outside of it nothing is known.
    """

    at: tuple[Number, ...]
    at_unit: str
    value: tuple[Number, ...]
    lower: tuple[Number, ...]
    upper: tuple[Number, ...]
    unit: str
    visited: tuple[Number, Number]


class Nearest(_Said):
    """An effect of the library that comes near, and why it is not it."""

    effect: str
    fails_because: str


class Native(_Said):
    """What of the law a plain MJCF has: whether all of it, what is lost, and what it still takes away held out."""

    exact: bool
    cost: str
    holdout_gain: Number | None


class Proposal(_Said):
    """A law that these recordings ask for: a proposal, never a cause.

    Errors and gains are on held-out motion, in short pieces of the part. `probability` is that a law at this port and
    of these variables is there, among those that were tried.
    """

    name: str
    port: Literal["torque", "command", "reading"]
    variables: tuple[str, ...]
    joints: tuple[str, ...]
    formula: str
    parameters: dict[str, Value]
    curve: Curve
    holdout_mse_before: Number
    holdout_mse_after: Number
    holdout_gain: Number
    holdout_gain_ci95: tuple[Number, Number]
    probability: Number
    null_probability: Number
    evidence: Number
    nearest: tuple[Nearest, ...]
    native: Native
    experiment: str
    file: str


class Rival(_Said):
    """A port and variables that were tried, and what they take away: by one linear step, and fitted (null: not)."""

    joint: str
    port: str
    variables: tuple[str, ...]
    linear_gain: Number
    holdout_gain: Number | None
    lost_because: str


class Proposals(_Said):
    """All that was found, why not more, and what else was tried. `hand` and `version` are those of the command."""

    verdict: str
    reason: str
    proposals: tuple[Proposal, ...] = ()
    tried: tuple[Rival, ...] = ()
    notes: tuple[str, ...] = ()
    hand: str | None = None
    version: str | None = None
