"""What a motion could have shown: without that, an error at the noise says nothing."""

from __future__ import annotations

import contextlib

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis, hypotheses
from twin_daemon.diagnosis.fit import own_columns
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.thresholds import DECISIVE_NATS, MOST_UNDETECTABLE
from twin_daemon.errors import BadInput
from twin_daemon.estimation.posterior import Posterior
from twin_daemon.executor import concurrently


def undetectable(part: PartFit) -> list[str]:
    """The effects, weak ones, that would have drowned in what is uncertain anyway, if they are more than a third.

    Empty where the motion is rich enough, or where somebody has said which errors matter. The power of a test: each
    effect at its weakest start, at the servos of the joints that move, less what the nuisances could do instead.
    """
    if part.twin.hand.description.tolerance_rad is not None:
        return []  # errors that do not matter need not be seen
    servos = zip(part.twin.actuators, part.twin.driven, strict=True)
    driving = [servo for servo, driven in servos if set(driven) & set(part.joints)]
    asked = [h for h in hypotheses(part.twin, part.joints, whole_hand=False) if h.target in driving]
    without = _coarsely(part, None, {})
    basis, _ = np.linalg.qr(part.base.slopes)

    def hides(hypothesis: Hypothesis) -> bool:
        values = _weakest(hypothesis)
        with contextlib.suppress(BadInput):
            change = _coarsely(part, hypothesis, values) - without
            change = change - basis @ (basis.T @ change)
            price = len(own_columns(part.problem_with((hypothesis, values)))) * np.log(part.problem.effective_samples)
            return bool(float(change @ change) <= 2.0 * DECISIVE_NATS + price)
        return False

    hidden = [h.name for h, is_hidden in zip(asked, concurrently(hides, asked), strict=True) if is_hidden]
    return hidden if len(hidden) > MOST_UNDETECTABLE * len(asked) else []


def _coarsely(part: PartFit, hypothesis: Hypothesis | None, values: dict[str, float]) -> np.ndarray:
    """(m,) rows with an effect beside the nuisances where they fit best alone, at twice the time step."""
    twin, held = part.coarse, []
    if hypothesis is not None:
        twin = twin.changed(twin.terms.with_effect(hypothesis.term(values)))
        held = sorted(hypothesis.holds_offset())
    problem = Posterior(
        twin, part.recordings, part.variables, part.joints, part.floor, offset_held=held, corrections=part.corrections
    )
    return problem.residuals(part.base.point[None])[0]


def _weakest(hypothesis: Hypothesis) -> dict[str, float]:
    """The start that is nearest to neutral in the effect's first parameter."""
    first = hypothesis.effect.parameters[0]

    def size(values: dict[str, float]) -> float:
        value = values[first.name]
        return abs(np.log(value / first.neutral)) if first.log and first.neutral > 0 else abs(value - first.neutral)

    return min(hypothesis.starts, key=size)
