"""What a ladder has climbed: its steps, the twin at its top, and the errors that they are judged by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from twin_daemon.comparison.compare import compare_recording, mean_over_moving, pooled
from twin_daemon.diagnosis.verdict import VerdictName
from twin_daemon.estimation.uncertainty import Estimate
from twin_daemon.simulation.alignment import Aligned
from twin_daemon.simulation.twin import TwinModel


@dataclass(frozen=True)
class Step:
    """The twin after one more effect, and what the diagnosis says of it then.

    `effect` is None in the first step, and in one that fits the values of all effects and parameters `together`.
    Errors in rad^2 over the joints that move. `parameters` are the effect's fitted values, `confusable_with` what the
    data did not tell it from.
    """

    effect: str | None
    target: str | None
    joints: tuple[str, ...]
    parameters: dict[str, float]
    mse_rad2: float | None
    holdout_mse_rad2: float | None
    verdict: VerdictName | None
    together: bool = False
    confusable_with: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The effect and where, with what it may be instead."""
        instead = f" (or {', '.join(self.confusable_with)})" if self.confusable_with else ""
        return f"{self.effect} at {self.target}{instead}"

    def better_than(self, other: Step) -> bool:
        """Whether held-out motion is predicted better."""
        new, old = self.holdout_mse_rad2, other.holdout_mse_rad2
        return new is not None and old is not None and new < old


@dataclass
class Ladder:
    """What has been climbed. `twin` has all effects of the steps. `refused` are findings that did not hold."""

    twin: TwinModel
    steps: list[Step]
    reason: str = ""
    refused: list[str] = field(default_factory=list)
    parameters_alone: tuple[float | None, float | None] = (None, None)
    interrupted: bool = False
    parameters: dict[str, Estimate] = field(default_factory=dict)

    @property
    def added(self) -> int:
        """How many effects have been added."""
        return sum(step.effect is not None for step in self.steps)

    @property
    def last_judged(self) -> Step:
        """The last step that held-out motion has judged; the first where there is none."""
        return next((s for s in reversed(self.steps) if s.holdout_mse_rad2 is not None), self.steps[0])

    def spares(self, joints: Sequence[str]) -> bool:
        """Whether none of some joints has been given an effect."""
        return not any(set(joints) & set(step.joints) for step in self.steps if step.effect is not None)

    def take_back(self, twin: TwinModel) -> None:
        """Back to the beginning: what was added is listed with what did not hold."""
        self.refused += [f"{step.effect}:{step.target}" for step in self.steps if step.effect is not None]
        self.twin, self.steps, self.parameters = twin, self.steps[:1], {}


def mean_error(twin: TwinModel, recordings: Sequence[Aligned], joints: Sequence[str] = ()) -> float | None:
    """Mean squared error (rad^2) of the twin over the joints that move, or over some of them; None for no data."""
    if not recordings:
        return None
    found = pooled([compare_recording(twin, r) for r in recordings])
    return mean_over_moving(found, joints) if joints else mean_over_moving(found)
