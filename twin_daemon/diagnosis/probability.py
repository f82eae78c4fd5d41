"""How probable each cause is: a posterior over nothing, each effect at its place, their pairs, and no law of these.

Three things are weighed. Between candidates for one place among the causes: their evidence, counted at the rate at
which evidence is worth its name (nats over an assumed noise are more than one can bet on: model errors are correlated,
and laws differ in form by as much). Against nothing: the price of having asked so many. Against a law that is not in
the library: what is left on motion that was not fitted, beside what a right model leaves, and how many causes the
answer needs. The numbers are set on robots drawn at random, whose answers are known (`python -m bench.set_thresholds`).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product

from twin_daemon.diagnosis.thresholds import (
    ADEQUACY_SLOPE,
    ADEQUACY_SLOPE_WITHIN,
    FURTHER_CAUSE_ODDS,
    LEAST_ADEQUACY,
    LEAST_PROBABILITY,
    RIVAL_ODDS,
    TOO_WEAK,
    UNKNOWN_PRIOR_ABOVE,
    UNKNOWN_PRIOR_UNNAMED,
    UNKNOWN_PRIOR_WITHIN,
)
from twin_daemon.diagnosis.verdict import Probability

NOTHING, UNKNOWN, WEAK = "nothing", "unknown", "too_weak"


def weight(
    cost_before: float, cost: float, prior_before: float, prior: float, price: float, decisive_nats: float
) -> float:
    """Evidence of a candidate in nats, such that `posterior` counts what the priors say of it for what it is.

    Costs are minus twice a log posterior, `prior` what of it the priors of uncertain values say. How far errors of a
    model are correlated is a matter of the data: that a gain is six sigma from its nominal value unless the servo is
    weak is said by the prior, and no nat of it is worth less.
    """
    data = 0.5 * (cost_before - prior_before - cost + prior)
    return data + _nats_each(decisive_nats) * (0.5 * (prior_before - prior) - price)


def _nats_each(decisive_nats: float) -> float:
    """How many nats of the data make odds of e to one."""
    return decisive_nats / math.log(RIVAL_ODDS)


def posterior(evidence_nats: Mapping[str, float], decisive_nats: float) -> dict[str, float]:
    """Probabilities of the candidates for one place among the causes, and of nothing, given that it is one of these.

    `evidence_nats` are their gains over the model without, after their price; `decisive_nats` is how far
    behind a candidate has to be for odds of RIVAL_ODDS against it. All have the same prior; together they have that of
    nothing.
    """
    scale = _nats_each(decisive_nats)
    nats = {**evidence_nats, NOTHING: math.log(max(len(evidence_nats), 1))}
    most = max(nats.values())
    weights = {name: math.exp((value - most) / scale) for name, value in nats.items()}
    total = sum(weights.values())
    return {name: weight / total for name, weight in weights.items()}


@dataclass(frozen=True)
class Beliefs:
    """The numbers that make probabilities of what was found and of what is left; by default those in use."""

    unknown_above: float = UNKNOWN_PRIOR_ABOVE
    unknown_unnamed: float = UNKNOWN_PRIOR_UNNAMED
    unknown_within: float = UNKNOWN_PRIOR_WITHIN
    slope: float = ADEQUACY_SLOPE
    slope_within: float = ADEQUACY_SLOPE_WITHIN
    least_adequacy: float = LEAST_ADEQUACY
    further_cause_odds: float = FURTHER_CAUSE_ODDS
    too_weak: float = TOO_WEAK


IN_USE = Beliefs()


@dataclass(frozen=True)
class Left:
    """What is left of a part with what was found there: what says how probable it is that it lacks another law.

    `adequacy` is what is left on held-out motion, in what a right model may leave, or how far off the furthest nuisance
    has to be, in what any plausible robot has, whichever is more. `above` says that the part is above the floor, and
    `named` that something was found there.
    """

    adequacy: float
    above: bool
    named: bool

    def unknown(self, causes: int = 1, beliefs: Beliefs = IN_USE) -> float:
        """Probability that none of the library's laws is what the part lacks.

        `causes` is how many the whole answer has: the more it needs, the more probable is one law that is not among
        the library's and looks like all of them.
        """
        if self.named:
            prior, slope, least = beliefs.unknown_above, beliefs.slope, beliefs.least_adequacy
        elif self.above:
            prior, slope, least = beliefs.unknown_unnamed, beliefs.slope, 0.0
        else:
            prior, slope, least = beliefs.unknown_within, beliefs.slope_within, 0.0
        odds = prior / (1.0 - prior) * min(max(self.adequacy, least), 1e3) ** slope
        if self.named:
            odds *= beliefs.further_cause_odds ** (max(causes, 1) - 1)
        return odds / (1.0 + odds)


def combined(
    causes: Iterable[Mapping[str, float]], unknowns: Iterable[float], beliefs: Beliefs = IN_USE
) -> tuple[Probability, ...]:
    """Probabilities of all sets of causes that are not negligible, the most probable first.

    `causes` holds one distribution for each place among the causes, as `posterior` gives them; `unknowns` for each part
    how probable it is that none of the library's laws is at work there. Places and parts are taken as independent.
    Where none of all that could be seen is missing, something may still be that is too weak for these data.
    """
    sets: dict[tuple[str, ...], float] = {(): math.prod(1.0 - share for share in unknowns)}
    beyond = 1.0 - sets[()]
    for one in causes:
        longer: dict[tuple[str, ...], float] = {}
        for (names, share), (name, more) in product(sets.items(), one.items()):
            if share * more > LEAST_PROBABILITY:  # no set that holds it is more probable than that
                joined = names if name == NOTHING or name in names else (*names, name)
                longer[joined] = longer.get(joined, 0.0) + share * more
        sets = longer
    nothing = sets.pop((), 0.0)
    sets |= {
        (NOTHING,): (1.0 - beliefs.too_weak) * nothing,
        (WEAK,): beliefs.too_weak * nothing,
        (UNKNOWN,): beyond,
    }
    found = [Probability(effects=names, probability=share) for names, share in sets.items()]
    return tuple(sorted((p for p in found if p.probability > LEAST_PROBABILITY), key=lambda p: -p.probability))
