"""What a diagnosis says: verdicts are values, and each finding carries its evidence."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

VerdictName = Literal["explained", "ambiguous", "not_excited", "unexplained", "within_noise"]

IN_WORDS = {
    "explained": "Explained: the library has what the twin lacks.",
    "ambiguous": "Ambiguous: more than one effect explains these data equally well.",
    "not_excited": "Not excited: this motion cannot show what the twin lacks.",
    "unexplained": "Unexplained: something is missing that no effect of the library accounts for.",
    "within_noise": "Within noise: these data ask for no further effect.",
}


@dataclass(frozen=True)
class FittedValue:
    """One parameter of a fitted effect with its 95 % interval, in `unit`."""

    value: float
    unit: str
    ci95: tuple[float, float]


@dataclass(frozen=True)
class Finding:
    """One effect that the data ask for. Errors are mean squared errors (rad^2) on held-out motion."""

    effect: str
    target: str
    joints: tuple[str, ...]
    parameters: dict[str, FittedValue]
    evidence: float
    holdout_mse_before: float
    holdout_mse_after: float
    holdout_gain: float
    holdout_gain_ci95: tuple[float, float]
    confusable_with: tuple[str, ...]
    explanation: str


@dataclass(frozen=True)
class Trial:
    """A candidate and why it did not win. `evidence` is its gain over the model alone, in nats."""

    effect: str
    target: str
    evidence: float
    fit_mse_rad2: float | None
    holdout_mse_rad2: float | None
    lost_because: str


@dataclass(frozen=True)
class Diagnosis:
    """The whole answer."""

    verdict: VerdictName
    reason: str
    findings: tuple[Finding, ...]
    tried: tuple[Trial, ...]
    where: tuple[dict[str, Any], ...]
    parts: dict[str, dict[str, Any]]
    moved_parameters: tuple[dict[str, Any], ...] = ()
    next_experiment: dict[str, Any] | None = None
    interrupted: bool = False
    notes: list[str] = field(default_factory=list)
