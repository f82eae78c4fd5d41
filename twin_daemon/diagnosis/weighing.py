"""What is known of candidates for one place, in nats: what `posterior` makes probabilities of."""

from __future__ import annotations

from collections.abc import Sequence

from twin_daemon.diagnosis.fit import FirstFit, Fit
from twin_daemon.diagnosis.part_fit import PartFit
from twin_daemon.diagnosis.probability import weight
from twin_daemon.diagnosis.screening import Screening
from twin_daemon.diagnosis.thresholds import ALIKE, DECISIVE_NATS


def weighed(
    part: PartFit, screening: Screening, first_fits: Sequence[FirstFit], fits: Sequence[Fit]
) -> dict[str, float]:
    """What is known of each candidate by name, as `posterior` counts it: by its full fit, else by its first."""
    bar = decisive(min(fits, key=lambda fit: fit.cost)) if fits else DECISIVE_NATS
    prior, found = part.base.prior_cost, {}
    for first in first_fits:
        price = part.price(first.problem)
        evidence = 0.5 * (screening.cost - first.cost) - price
        # what is not worth its parameters is not there, whatever the priors say of the little that it has moved
        if part.within_floor and evidence > 0.0:
            evidence = weight(screening.cost, first.cost, prior, first.prior_cost, price, bar)
        found[first.hypothesis.name] = evidence
    return found | {fit.name: weight_of(part, fit, bar) for fit in fits}


def weight_of(part: PartFit, fit: Fit, bar: float) -> float:
    """What is known of a fit over the nuisances alone, as `posterior` counts it where `bar` nats are decisive.

    Where uncertain values alone bring a part to its floor, their priors tell what the data do not.
    """
    if not part.within_floor:
        return part.evidence_nats(fit)
    return weight(part.base.cost, fit.cost, part.base.prior_cost, fit.prior_cost, part.price_of(fit), bar)


def decisive(best: Fit) -> float:
    """Nats by which another candidate has to be behind: more where the best is itself not down at the noise."""
    return max(DECISIVE_NATS, ALIKE * 0.5 * best.cost)
