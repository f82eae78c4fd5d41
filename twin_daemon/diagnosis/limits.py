"""Laws that become one another at a bound of theirs: each is fitted from where the other has come to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from twin_daemon.diagnosis.candidates import Hypothesis
from twin_daemon.diagnosis.fit import Fit
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.thresholds import DECISIVE_NATS, FULL_FIT_ROLLOUTS
from twin_daemon.executor import concurrently_here


def limits_of(part: PartFit, screening: Screening, laws: Sequence[Fit]) -> list[Fit]:
    """The laws that fitted ones become at a bound of theirs, fitted from where these have come to.

    No position data may tell the two apart, so that neither may be the only answer for want of a start. Those that were
    fitted from starts of their own stay as they are.
    """
    fitted = {law.name for law in laws}
    asked = [hypothesis for hypothesis in screening.candidates if hypothesis.name not in fitted]
    pairs = [(h, law) for law in laws for h in asked if law.hypothesis and h.is_limit_of(law.hypothesis)]

    def fitted_from(pair: tuple[Hypothesis, Fit]) -> Fit:
        hypothesis, law = pair
        return fitted_at(part, hypothesis, hypothesis.effect.as_limit_of(law.values), law.nuisances)

    return concurrently_here(fitted_from, pairs)


def laws_at_limits(part: PartFit, screening: Screening, limits: Sequence[Fit]) -> list[Fit]:
    """The laws that become fitted ones at a bound of theirs, fitted from there where they are not clearly better.

    At that bound a law does what its limit does: one that is worse has ended in a local optimum.
    """
    costs = {fit.name: fit.cost for fit in limits}
    pairs = [
        (law, limit)
        for limit in limits
        for law in screening.candidates
        if limit.hypothesis
        and limit.hypothesis.is_limit_of(law)
        and costs.get(law.name, np.inf) > limit.cost - 2.0 * DECISIVE_NATS
    ]

    def fitted_from(pair: tuple[Hypothesis, Fit]) -> Fit:
        law, limit = pair
        assert limit.hypothesis is not None
        return fitted_at(part, law, limit.hypothesis.effect.as_law_at_limit(limit.values), limit.nuisances)

    return concurrently_here(fitted_from, pairs)


def fitted_at(
    part: PartFit, hypothesis: Hypothesis, values: Mapping[str, float], nuisances: Mapping[str, float]
) -> Fit:
    """The full fit of a candidate from known values and nuisances; of those that are not given, from nominal ones."""
    begun = hypothesis.starting((values, *hypothesis.starts))
    problem = part.problem_with((begun, begun.starts[0]))
    return part.ended(begun, problem, problem.start_from(nuisances), FULL_FIT_ROLLOUTS)
